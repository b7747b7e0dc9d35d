"""Figures, drawn from trajectories and metrics; matplotlib is imported when the first is drawn."""

from spikelane.figures.lap import draw_lap

__all__ = ['draw_lap']
