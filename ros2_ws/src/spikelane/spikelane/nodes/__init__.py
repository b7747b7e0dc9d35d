"""The nodes of package spikelane."""
