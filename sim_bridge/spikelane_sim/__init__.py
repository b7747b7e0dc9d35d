"""Course, robot, event camera and Gymnasium environment; free of ROS except for `nodes`."""

from spikelane_sim.registration import register_when_imported

register_when_imported()
