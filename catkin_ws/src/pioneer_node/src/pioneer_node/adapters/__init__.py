"""Code that needs the operating system, but not rospy."""
