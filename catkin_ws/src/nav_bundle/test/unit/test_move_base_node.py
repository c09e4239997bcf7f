"""Parts of the move_base node without a ROS master: what it commands last, and which scans reveal wheel slip."""

from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Twist

from nav_bundle.costmap.config import SourceConfig
from nav_bundle.costmap.layer import Observation
from nav_bundle.costmap.node import CostmapNode
from nav_bundle.costmap.source import Arrival, Source
from nav_bundle.move_base.navigator import Report
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
