"""Code that needs rospy: node entry point, launchers, dynamic reconfigure, patches of rospy."""
