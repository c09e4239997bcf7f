"""Nodes that do not compute anything do not load numpy, but can if they need it."""

import subprocess
import sys

import pytest

LATER = """
import sys
from pioneer_node.adapters.light_import import import_without_numpy
import_without_numpy("rospy")
assert "numpy" not in sys.modules
import io, numpy
from geometry_msgs.msg import Point
out = io.BytesIO()
Point(numpy.float64(1.0), 2.0, 3.0).serialize(out)
assert len(out.getvalue()) == 24
"""
BEFORE = """
import numpy, sys
from pioneer_node.adapters.light_import import import_without_numpy
import_without_numpy("rospy")
assert sys.modules["numpy"] is numpy
"""
NODES = [
    "rocon_gateway.node.gateway",
    "rocon_hub.hub",
    "simple_navigation_goals.map_navigation_client",
]


@pytest.mark.parametrize("code", [LATER, BEFORE], ids=["numpy after it", "numpy before it"])
def test_numpy_can_be_used_all_the_same(code: str) -> None:
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("node", NODES)
def test_a_node_that_computes_nothing_does_without(node: str) -> None:
    code = (
        "import sys; from pioneer_node.adapters.light_import import import_without_numpy\n"
        f"import_without_numpy('{node}'); sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
