"""What needs rospy: the entry point of a node."""
