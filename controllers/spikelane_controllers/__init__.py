"""Spiking networks, encoding and decoding; free of ROS except for `nodes`."""
