"""What needs rospy: the controller node."""
