"""Experiments: many runs that one file describes, done by several processes."""
