"""The rules that each script requests; does not need ROS."""
