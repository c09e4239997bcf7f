"""Learning environments without ROS, and a driver that is trained in them."""
