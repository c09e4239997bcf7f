"""What needs rospy: the navigation nodes and what they share."""
