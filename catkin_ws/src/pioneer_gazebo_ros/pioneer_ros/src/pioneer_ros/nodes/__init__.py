"""ROS node: the velocity controller."""
