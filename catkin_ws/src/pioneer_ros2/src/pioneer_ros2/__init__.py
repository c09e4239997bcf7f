"""A door from a ROS 1 master into a ROS 2 domain."""
