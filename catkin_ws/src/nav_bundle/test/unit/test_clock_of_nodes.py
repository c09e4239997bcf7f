"""Localisation and mapping start again only with a world that does: a clock that is set back costs nothing learnt."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import rospy

from nav_bundle.base.clock import ClockWatch
from nav_bundle.base.pose import Pose
from nav_bundle.localisation.node import AmclNode
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.mapping.node import SlamGmappingNode

NOW = 5000.0
CASES = [(True, 0.2, False), (True, 30.0, True), (False, 0.2, False), (False, 3600.0, False)]


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)


def clock(simulated: bool) -> ClockWatch:
    watch = ClockWatch(simulated)
    watch.read(NOW)
    return watch


@pytest.mark.parametrize(("simulated", "back", "restarts"), CASES)
def test_amcl_goes_back_to_its_initial_pose_only_when_time_starts_again(
    monkeypatch: pytest.MonkeyPatch, simulated: bool, back: float, restarts: bool
) -> None:
    """A step back longer than a scan's period used to reset it, on wall time, too: 3.26 m off."""
    calls: list[str] = []
    node = SimpleNamespace(
        _clock=clock(simulated),
        _store=SimpleNamespace(restart=lambda: None),
        _correction=SimpleNamespace(forget=lambda: calls.append("forget")),
        _start_at_initial_pose=lambda: calls.append("start"),
        _remembered=None,
    )
    monkeypatch.setattr(rospy, "get_time", lambda: NOW - back)
    AmclNode._read_clock(node)  # type: ignore[arg-type]
    assert calls == (["start", "forget"] if restarts else [])


@pytest.mark.parametrize(("simulated", "back", "restarts"), CASES)
def test_gmapping_loses_its_map_only_when_time_starts_again(
    monkeypatch: pytest.MonkeyPatch, simulated: bool, back: float, restarts: bool
) -> None:
    slam = object()
    node = SimpleNamespace(
        _clock=clock(simulated),
        _config=GmappingConfig(particles=1),
        _slam=slam,
        _map_from_odom=Pose(1.0, 2.0, 0.3),
        _next_map=np.inf,
    )
    monkeypatch.setattr(rospy, "get_time", lambda: NOW - back)
    SlamGmappingNode._read_clock(node)  # type: ignore[arg-type]
    assert (node._slam is not slam) == restarts
    assert (node._map_from_odom is None) == restarts
    assert math.isinf(node._next_map)
    assert node._next_map < 0.0, "the next map would come only when the clock is as far again"
