"""What needs rospy: the waypoint clients and the spin recovery."""
