"""A lap over ROS."""
