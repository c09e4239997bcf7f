"""The pure core of the gateway: no ROS, sockets, clocks or threads."""
