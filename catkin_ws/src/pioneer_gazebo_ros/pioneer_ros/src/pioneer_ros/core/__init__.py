"""What needs no ROS: the gains, and the watch over a source of commands."""
