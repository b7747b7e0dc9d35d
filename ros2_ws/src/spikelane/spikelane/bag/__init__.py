"""Bags: recordings in the exact shape of rosbag2's MCAP files, written and read without ROS."""
