"""Fleet state and its interpretation; does not need ROS."""
