"""The simulator as a ROS 2 node, and what every Spikelane node is made of."""
