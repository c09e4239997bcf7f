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
from nav_bundle.move_base.node import MoveBaseNode


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
