"""Many robots at once: N laps or trainings in one kernel, each as it would be alone."""

from spikelane.fleet.fleet import Fleet

__all__ = ['Fleet']
