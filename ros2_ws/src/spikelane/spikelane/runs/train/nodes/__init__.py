"""A training over ROS."""
