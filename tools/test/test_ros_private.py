"""Private parts of ROS's packages are found by every way of naming them, and only those."""

from pathlib import Path

import pytest

from ros_private import findings

FOUND = {
    "import rospy\nrospy.rostime._set_rostime(0)": [
        "2: rospy.rostime._set_rostime is private to ROS"
    ],
    "import rospy\nrospy.impl.simtime": ["2: rospy.impl is private to ROS"],
    "import rospy.impl.registration": ["1: rospy.impl.registration is private to ROS"],
    "import rospy.topics as t\nt._x": ["2: rospy.topics._x is private to ROS"],
    "from rospy.impl import tcpros": ["1: rospy.impl.tcpros is private to ROS"],
    "from rospy import core as c\nc._add(1)": ["2: rospy.core._add is private to ROS"],
    "def f():\n  import rospy\n  rospy.Timer = 1": ["3: replaces rospy.Timer"],
    "import rospy\nrospy.a, rospy.b = 1, 2": ["2: replaces rospy.a", "2: replaces rospy.b"],
    "from rospy.topics import Publisher\nPublisher.publish = 1": [
        "2: replaces rospy.topics.Publisher.publish"
    ],
    "import rospy\ndel rospy.Timer": ["2: replaces rospy.Timer"],
    "from rosmaster import util": ["1: rosmaster.util is private to ROS"],
}
ALLOWED = [
    "import rospy\nrospy.topics.Publisher",
    "import rospy\nx = rospy.__name__",
    "from roslaunch.pmon import ProcessListener",
    "import mine\nmine._x = 1",
    "class A:\n  def f(self):\n    self._rospy = 1",
    "import rospyx\nrospyx._y",
]


@pytest.mark.parametrize(("code", "expected"), FOUND.items())
def test_private_parts_are_found(tmp_path: Path, code: str, expected: list[str]) -> None:
    path = tmp_path / "module.py"
    path.write_text(code)
    assert list(findings(path)) == [f"{path}:{text}" for text in expected]


@pytest.mark.parametrize("code", ALLOWED)
def test_public_parts_are_not(tmp_path: Path, code: str) -> None:
    path = tmp_path / "module.py"
    path.write_text(code)
    assert not list(findings(path))
