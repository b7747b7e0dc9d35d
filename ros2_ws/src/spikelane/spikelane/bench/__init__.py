"""Measurements of what is promised about speed and loss, each on this machine in one run."""
