"""What the launch files are made of; it takes ROS's `launch` and `launch_ros`."""
