"""The coordinator node: the only place for rospy."""
