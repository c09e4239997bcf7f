"""Roadmap, paths for many robots, and their agreement on the right of way; no ROS."""
