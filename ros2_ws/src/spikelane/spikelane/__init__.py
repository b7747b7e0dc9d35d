"""Spikelane: laps, recordings, metrics and pictures of the lane-keeping experiment.

Importing it registers the environment `spikelane/LaneKeeping-v0` with Gymnasium.
"""

import spikelane_sim  # noqa: F401
