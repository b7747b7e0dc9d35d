"""A lap: one controller drives one lane."""
