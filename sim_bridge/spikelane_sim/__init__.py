"""Course, robot, event camera and Gymnasium environment; free of ROS but for `nodes`."""
