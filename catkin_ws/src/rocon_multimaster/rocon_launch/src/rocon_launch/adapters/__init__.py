"""Adapters: the roslaunch processes."""
