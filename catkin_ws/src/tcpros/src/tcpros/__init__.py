"""TCPROS without rospy: wire formats, and non-blocking connections served by one thread."""
