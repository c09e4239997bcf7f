"""Writes many parameters in one request."""

import xmlrpc.client
from collections.abc import Mapping
from typing import Any

import rosgraph
import rospy


def set_parameters(values: Mapping[str, Any]) -> None:
    """Sets parameters by name in a single request: one request per parameter would cost a node more than its work.

    Logs a warning if the ROS master does not answer.
    """
    calls = xmlrpc.client.MultiCall(xmlrpc.client.ServerProxy(rosgraph.get_master_uri()))
    for name, value in values.items():
        calls.setParam(rospy.get_name(), rospy.resolve_name(name), value)
    try:
        calls()
    except (OSError, xmlrpc.client.Error) as error:
        rospy.logwarn_throttle(30, "cannot write to the parameter server: %s", error)
