"""The controllers as ROS 2 nodes."""
