"""Measurements and their tables, without ROS."""
