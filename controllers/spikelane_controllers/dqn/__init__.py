"""The deep Q-network controller (paper section 3)."""
