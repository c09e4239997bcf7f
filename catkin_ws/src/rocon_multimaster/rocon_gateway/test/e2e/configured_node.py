"""A node whose parameters dynamic_reconfigure changes."""

import rospy
from dynamic_reconfigure.cfg import TestConfig
from dynamic_reconfigure.server import Server

rospy.init_node("configured")
server = Server(TestConfig, lambda config, _level: config)
rospy.spin()
