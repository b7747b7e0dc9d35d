"""The sub-commands of `spikelane`."""
