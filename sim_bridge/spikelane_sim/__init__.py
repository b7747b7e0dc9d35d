"""Course, robot, event camera and Gymnasium environment; free of ROS but for `nodes`."""

try:
    import gymnasium
except ImportError:
    pass  # only the environment needs it
else:
    gymnasium.register('spikelane/LaneKeeping-v0', entry_point='spikelane_sim.env:LaneKeepingEnv')
