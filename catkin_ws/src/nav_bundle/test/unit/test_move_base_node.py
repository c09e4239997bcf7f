"""Parts of the move_base node without a ROS master.

What it commands last, which inputs it does not drive without, what a clock that is set back restarts, and which scans
reveal wheel slip.
"""

import math
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from nav_bundle.base.clock import ClockWatch
from nav_bundle.base.pose import Pose
from nav_bundle.base.transform import DisconnectedError, Transform
from nav_bundle.costmap.config import SourceConfig
from nav_bundle.costmap.layer import Observation
from nav_bundle.costmap.node import CostmapNode
from nav_bundle.costmap.source import Arrival, Source
from nav_bundle.move_base.navigator import Report, Sight
from nav_bundle.move_base.node import MoveBaseNode
from nav_bundle.move_base.reason import Condition


def test_an_exception_in_the_loop_still_ends_with_a_zero_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    commands = []

    def fail(_: float) -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "get_time", lambda: 1.0)
    node = SimpleNamespace(
        _has_all=lambda _: True,
        _offer=lambda: None,
        _turn_at=fail,
        stop=lambda: MoveBaseNode.stop(node),
        _velocity=SimpleNamespace(publish=commands.append),
    )
    with pytest.raises(RuntimeError):
        MoveBaseNode.spin(node)  # type: ignore[arg-type]
    assert commands == [Twist()]


def test_the_state_names_what_the_start_waits_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "loginfo_throttle", lambda *_: None)
    shown: list[Report] = []

    def costmap(*missing: str) -> SimpleNamespace:
        return SimpleNamespace(
            missing=lambda _: list(missing),
            update=lambda _: None,
            costmap=SimpleNamespace(ready=not missing),
        )

    node = MoveBaseNode.__new__(MoveBaseNode)
    node._shown_report = Report(Condition.STARTING)
    node._state = SimpleNamespace(show=lambda report, _: shown.append(report))  # type: ignore[assignment]
    node._global = costmap("the map on /map")  # type: ignore[assignment]
    node._local = costmap()  # type: ignore[assignment]
    assert not node._has_all(1.0)
    assert not node._has_all(2.0)
    assert shown[0].text() == "starting: waiting for the map on /map"
    assert shown[1] is shown[0]
    assert shown[0].since == 1.0


@pytest.mark.parametrize(
    ("frame", "usable"), [("pioneer1/odom", True), ("odom", True), ("map", False)]
)
def test_a_correction_by_localisation_is_no_wheel_slip(frame: str, usable: bool) -> None:
    source: Source[str] = Source(SourceConfig("base_scan"))
    observation = Observation(source.config, 0.0, 0.0, np.zeros((1, 2)))
    source.update([Arrival(1, 1.0, 1.0, "")], lambda _: observation, 1.0)
    node = SimpleNamespace(
        frame=frame, _sources=[SimpleNamespace(source=source)], _fault=lambda *_: ""
    )
    assert (CostmapNode.picture(node, 1.0) is not None) == usable  # type: ignore[arg-type]


ODOM_TIMEOUT = 0.5


class Inputs:
    """A node that has all its inputs at 10 s, until a test takes one away."""

    def __init__(self) -> None:
        self.faults = {"global": "", "local": ""}
        self.odometry: list[Arrival[Odometry]] = [Arrival(1, 10.0, 10.0, Odometry())]
        self.connected = True
        self.stops: list[str] = []
        node = self.node = MoveBaseNode.__new__(MoveBaseNode)
        node._global, node._local = self._costmap("global"), self._costmap("local")  # type: ignore[assignment]
        node._odometry = SimpleNamespace(  # type: ignore[assignment]
            topic="odom", arrivals=lambda: iter(self.odometry)
        )
        node._setup = SimpleNamespace(base=SimpleNamespace(odom_timeout=ODOM_TIMEOUT))  # type: ignore[assignment]
        node._listener = SimpleNamespace(lookup=self._lookup)  # type: ignore[assignment]
        node._blind = SimpleNamespace(warn=lambda _: None, end=lambda: None)  # type: ignore[assignment]
        node._safety_stop = SimpleNamespace(publish=lambda text, _: self.stops.append(text))  # type: ignore[assignment]

    def _costmap(self, name: str) -> Any:
        return SimpleNamespace(
            frame=name,
            pose=lambda _: Pose(),
            other_robots=lambda _: {},
            fault=lambda _: self.faults[name],
        )

    def _lookup(self, *_: str) -> Transform:
        if not self.connected:
            raise DisconnectedError("no transform from map to odom")
        return Transform()

    def sight(self, now: float = 10.0) -> Sight:
        return self.node._sight(now)

    def set_speed(self, speed: float) -> None:
        self.odometry[0].message.twist.twist.linear.x = speed


LOSSES: dict[str, tuple[Any, str]] = {
    "a source of the global costmap": (lambda all: all.faults.update({"global": "lost"}), "lost"),
    "a source of the local costmap": (lambda all: all.faults.update({"local": "lost"}), "lost"),
    "all odometry": (lambda all: all.odometry.clear(), "no odometry on odom"),
    "odometry's numbers": (lambda all: all.set_speed(math.nan), "linear.x"),
    "the transform of the costmaps": (lambda all: setattr(all, "connected", False), "map to odom"),
}


@pytest.mark.parametrize(("lose", "words"), LOSSES.values(), ids=LOSSES.keys())
def test_without_any_one_input_the_robot_does_not_drive_and_names_it(lose: Any, words: str) -> None:
    inputs = Inputs()
    assert inputs.sight().current
    lose(inputs)
    sight = inputs.sight()
    assert not sight.current
    assert words in sight.fault
    assert inputs.stops == ["", sight.fault]


def test_odometry_that_comes_no_more_stops_the_robot_after_its_timeout() -> None:
    inputs = Inputs()
    assert inputs.sight(10.0 + ODOM_TIMEOUT).current
    assert not inputs.sight(10.1 + ODOM_TIMEOUT).current


@pytest.mark.parametrize(
    ("simulated", "back", "done"),
    [
        (True, 0.3, ["times"]),
        (True, 30.0, ["restart"]),
        (False, 0.3, ["times"]),
        (False, 30.0, ["times"]),
    ],
)
def test_only_a_reset_makes_move_base_forget_its_obstacles(
    simulated: bool, back: float, done: list[str]
) -> None:
    """A step back of 0.2 s used to restart it, on wall time, too."""
    calls: list[str] = []
    node = MoveBaseNode.__new__(MoveBaseNode)
    node._turn = threading.RLock()
    node._clock = ClockWatch(simulated)
    node._clock.read(1000.0)
    node._restart = lambda _: calls.append("restart")  # type: ignore[method-assign]
    node._forget_times = lambda *_: calls.append("times")  # type: ignore[method-assign]
    node._cycle = lambda _: None  # type: ignore[method-assign]
    node._navigator = SimpleNamespace(report=Report())  # type: ignore[assignment]
    node._state = SimpleNamespace(show=lambda *_: None)  # type: ignore[assignment]
    node._heard = True
    node._turn_at(1000.0 - back)
    node._turn_at(1000.1 - back)
    assert calls == done
