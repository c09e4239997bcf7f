"""``PIONEER_FORK=0``: ROS stays as it is, and what needs the patches is refused with the reason."""

import os
import subprocess
import sys

import pytest

from pioneer_launch import door
from pioneer_node.adapters.launch_door import launch_door

UNTOUCHED = """
import rospy, rosmaster.threadpool, rosmaster.master_api, rosgraph.xmlrpc, threading
from rospy.impl.registration import RegManager
from pioneer_launch import door

def parts():
    return (rospy.topics.QueuedConnection, rospy.topics.is_shutdown, threading.excepthook,
            RegManager.publisher_update, rosgraph.xmlrpc.XmlRpcNode.shutdown, rospy.impl.tcpros_base.TCPServer.run,
            rosmaster.threadpool.sleep, hasattr(rosmaster.master_api.ROSMasterHandler, "awaitRegistrations"))

before = parts()
door.patch_node(lambda: False, lambda _: None)
door.patch_observer()
door.patch_master()
raise SystemExit([old is new for old, new in zip(before, parts(), strict=True)] != [True] * 8)
"""
WITHOUT_PACKAGE = """
import importlib.abc, sys
class Absence(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "pioneer_launch":
            raise ModuleNotFoundError(name=name)
sys.meta_path.insert(0, Absence())
import rospy
from pioneer_node.nodes import entry
original = rospy.topics.QueuedConnection
rospy.init_node = lambda *_, **__: None
class Node:
    def spin(self):
        assert rospy.topics.QueuedConnection is original
raise SystemExit(entry.run("node", Node))
"""


def _status(code: str, **variables: str) -> int:
    environment = {**os.environ, **variables}
    return subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode


def test_switched_off_no_part_of_ros_is_replaced() -> None:
    assert _status(UNTOUCHED, PIONEER_FORK="0") == 0
    assert _status(UNTOUCHED, PIONEER_FORK="1") == 1


def test_a_node_runs_on_plain_rospy_if_the_package_is_missing() -> None:
    assert _status(WITHOUT_PACKAGE) == 0


def test_lockstep_is_refused_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIONEER_FORK", "0")
    with pytest.raises(door.SwitchedOffError, match="PIONEER_FORK=0 switches off"):
        door.replace_topics(object, object, object, owns_time=True)


def test_nodes_find_the_package_by_its_name() -> None:
    assert launch_door() is door
