"""What needs rospy."""
