"""What drives and counts on a ROS master."""
