"""How nodes end."""

import subprocess
import sys

import pytest

SHUT_DOWN = """
import rospy
from pioneer_node.nodes import entry

def woken():
    print("is_shutdown", rospy.is_shutdown(), flush=True)

entry.on_shutdown(woken)
rospy.signal_shutdown("test")
"""


def test_a_loop_that_is_woken_at_shutdown_sees_the_shutdown():
    # rospy.on_shutdown calls before the flag is set: on a loaded machine amcl and others then slept on for ever.
    done = subprocess.run([sys.executable, "-c", SHUT_DOWN], capture_output=True, text=True, timeout=60, check=True)
    assert "is_shutdown True" in done.stdout


LOSES_ITS_MASTER = """
import os, signal, sys
import rospy
from pioneer_node.nodes import entry

rospy.init_node = lambda *_, **__: None

class Node:
    def spin(self):
        if "asked" in sys.argv:
            os.kill(os.getpid(), signal.SIGINT)
        raise ConnectionRefusedError("no master")

raise SystemExit(entry.run("node", Node))
"""


@pytest.mark.parametrize(("asked", "status"), [("asked", 0), ("", 1)])
def test_who_is_asked_to_end_and_has_lost_its_master_by_then_ends_without_a_traceback(asked: str, status: int) -> None:
    """A waypoint client that connected anew in that moment printed one. Where nobody has asked, it is a fault."""
    command = [sys.executable, "-c", LOSES_ITS_MASTER, asked]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == status
    assert ("Traceback" in done.stdout + done.stderr) == bool(status)
