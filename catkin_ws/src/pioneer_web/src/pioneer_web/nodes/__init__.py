"""Code that needs rospy or serves web pages."""
