"""Spikelane: laps, recordings, metrics and pictures of the lane-keeping experiment."""
