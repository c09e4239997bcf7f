"""The simulator as ROS nodes."""
