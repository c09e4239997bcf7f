"""What needs rospy or serves pages."""
