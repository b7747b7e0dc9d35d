"""Spiking networks, encoding and decoding; free of ROS but for `nodes`."""
