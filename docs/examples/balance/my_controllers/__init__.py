"""Controllers of another package than Spikelane's."""
