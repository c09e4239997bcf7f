"""What needs the system, but not rospy."""
