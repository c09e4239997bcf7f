"""Our own ROS master: the connections registered there, and when to poll it."""
