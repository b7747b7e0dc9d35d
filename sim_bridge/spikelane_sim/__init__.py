"""Course, robot, event camera and Gymnasium environment; free of ROS except for `nodes`."""

import gymnasium

gymnasium.register(
    'spikelane/LaneKeeping-v0',
    entry_point='spikelane_sim.env:LaneKeepingEnv',
    vector_entry_point='spikelane_sim.fleet.vector_env:make_vector_env',
)
