"""How nodes end."""

import subprocess
import sys

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
