"""The observer, which is the demo's eye and mouth in ROS, and the demo's course of events."""
