"""ROS nodes: the commands ESTOP and cancel_waypoint."""
