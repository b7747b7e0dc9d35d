"""Figures of several runs, and what all draw; matplotlib is imported when the first is drawn."""
