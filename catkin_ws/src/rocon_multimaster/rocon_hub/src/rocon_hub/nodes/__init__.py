"""The node: the only place for rospy."""
