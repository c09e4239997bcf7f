"""Code that needs rospy: node entry point, dynamic reconfigure."""
