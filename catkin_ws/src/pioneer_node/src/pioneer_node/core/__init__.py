"""What needs no ROS: frame names and parameter sets."""
