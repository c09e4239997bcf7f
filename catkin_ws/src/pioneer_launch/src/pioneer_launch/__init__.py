"""Processes forked from one interpreter, and all patches of ROS's own Python packages."""
