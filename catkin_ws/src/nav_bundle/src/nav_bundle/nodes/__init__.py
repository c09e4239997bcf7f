"""The navigation nodes and their shared rospy code."""
