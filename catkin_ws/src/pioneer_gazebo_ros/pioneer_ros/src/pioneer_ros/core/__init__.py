"""The ROS-free part: gains, and the watchdog of a command source."""
