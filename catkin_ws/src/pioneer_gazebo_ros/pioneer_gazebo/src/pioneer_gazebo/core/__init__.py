"""What the simulator computes: values and algorithms that know no ROS and no engine."""
