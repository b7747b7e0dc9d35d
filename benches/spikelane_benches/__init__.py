"""Measurements of what is promised about speed and loss; see `benchmarks`."""
