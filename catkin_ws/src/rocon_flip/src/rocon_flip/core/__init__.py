"""Which rules each script asks for: no ROS."""
