"""What needs rospy: the commands ESTOP and cancel_waypoint."""
