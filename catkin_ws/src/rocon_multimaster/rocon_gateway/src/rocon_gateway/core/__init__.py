"""Pure parts of the gateway: no ROS, no socket, no clock, no thread."""
