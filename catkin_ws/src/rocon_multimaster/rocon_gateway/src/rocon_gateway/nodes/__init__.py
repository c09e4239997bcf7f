"""Nodes and command-line tools: the only place for rospy."""
