"""Starts the launch files of a .concert file, each on its own ROS master."""
