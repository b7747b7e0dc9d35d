"""A replay over ROS."""
