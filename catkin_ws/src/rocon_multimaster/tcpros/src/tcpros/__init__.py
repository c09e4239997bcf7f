"""TCPROS without rospy: wire formats, and connections that one thread waits for."""
