import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from drawn_room import ROOM, enlarged, ranges_at

from nav_bundle.base.clock import ClockWatch
from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Scan
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.correction_file import (
    Correction,
    CorrectionFile,
    CorrectionFileError,
    has_continued,
)
from nav_bundle.localisation.localisation import Localisation
from nav_bundle.localisation.node import AmclNode
from nav_bundle.localisation.topics import PoseStore

ODOM = Pose(4.0, 3.0, 1.0)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "correction"
    CorrectionFile(str(path)).write(Correction(Pose(1.5, -2.25, 0.75), ODOM), "odom")
    CorrectionFile(str(path)).write(Correction(Pose(1.0, -2.0, 0.5), ODOM), "odom")
    assert CorrectionFile(str(path)).read("odom") == Correction(Pose(1.0, -2.0, 0.5), ODOM)
    assert list(tmp_path.iterdir()) == [path]


def test_of_another_robot_nothing_is_remembered(tmp_path: Path) -> None:
    path = tmp_path / "correction"
    CorrectionFile(str(path)).write(Correction(Pose(1.5, -2.25, 0.75), ODOM), "pioneer1/odom")
    assert CorrectionFile(str(path)).read("pioneer2/odom") is None


def test_no_file_is_no_memory(tmp_path: Path) -> None:
    assert CorrectionFile(str(tmp_path / "correction")).read("odom") is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"odom": "odom", "x": 1, "y": 2}',
        '{"x": 1, "y": 2, "yaw": 0}',
        '{"odom": "odom", "x": 1, "y": 2, "yaw": NaN}',
        '{"odom": "odom", "x": "a", "y": 2, "yaw": 0}',
        '{"odom": "odom", "x": 1, "y": 2, "yaw": 0}',
    ],
)
def test_a_file_of_something_else_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "correction"
    path.write_text(text)
    with pytest.raises(CorrectionFileError, match="correction"):
        CorrectionFile(str(path)).read("odom")


def test_amcl_starts_at_its_initial_pose_where_the_file_holds_something_else(
    tmp_path: Path,
) -> None:
    """amcl used to exit on such a file, and was respawned every few seconds."""
    path = tmp_path / "correction"
    node = SimpleNamespace(_correction=CorrectionFile(str(path)), _odom_frame="odom")
    path.write_text("")
    assert AmclNode._read_correction(node) is None  # type: ignore[arg-type]
    node._correction.write(Correction(Pose(1.0, -2.0, 0.5), ODOM), "odom")
    assert AmclNode._read_correction(node) == Correction(Pose(1.0, -2.0, 0.5), ODOM)  # type: ignore[arg-type]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CorrectionFileError, match="absent"):
        CorrectionFile(str(tmp_path / "absent" / "correction")).write(
            Correction(Pose(), ODOM), "odom"
        )


def test_a_correction_is_forgotten_when_time_jumps_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to survive: an amcl restarted before the next write resumed at the pose from before the reset."""
    file = CorrectionFile(str(tmp_path / "correction"))
    file.write(Correction(Pose(1.0, -2.0, 0.5), ODOM), "odom")
    clock = ClockWatch(simulated=True)
    clock.read(50.0)
    node = SimpleNamespace(
        _clock=clock, _correction=file, _store=PoseStore(1.0), _start_at_initial_pose=lambda: None
    )
    monkeypatch.setattr(rospy, "get_time", lambda: 3.0)
    AmclNode._read_clock(node)  # type: ignore[arg-type]
    assert file.read("odom") is None
    file.forget()


@pytest.mark.parametrize(
    ("odom", "applies"),
    [
        (ODOM, True),
        (Pose(4.5, 3.5, 1.5), True),
        (Pose(), False),
        (Pose(0.4, 0.1, -0.5), False),
        (Pose(0.0, 0.0, 1.0), False),
    ],
)
def test_a_correction_is_not_for_odometry_that_was_restarted_at_zero(
    odom: Pose, applies: bool
) -> None:
    assert Correction(Pose(1.0, 2.0, 0.3), ODOM).applies_to(odom) == applies


def test_odometry_that_was_at_zero_has_continued() -> None:
    assert Correction(Pose(1.0, 2.0, 0.3), Pose()).applies_to(Pose())


@pytest.mark.parametrize(
    "back", [Pose(0.05, 0.0, 0.0), Pose(0.3, -0.2, 0.4), Pose(-0.2, 0.1, -0.5)]
)
def test_a_robot_that_drove_on_to_near_its_start_has_not_restarted_its_odometry(back: Pose) -> None:
    """Its amcl once started at the initial pose, metres and degrees off, and took its goal for occupied."""
    assert Correction(Pose(1.0, 2.0, 0.3), Pose(0.9, 0.4, 0.2)).applies_to(back)


INITIAL = Pose(1.5, 1.0, 0.0)
"""Where the odometry of the robot below was at zero."""


def agreements(truth: Pose):
    """Returns a function of the share of beams that fit the map at a pose, for a robot at ``truth``."""
    grid, laser = enlarged(ROOM), Pose(0.1, 0.0, 0.0)
    config = AmclConfig(laser_max_range=12.0)
    localisation = Localisation(config, np.random.default_rng(1))
    localisation.set_map(grid)
    ranges = ranges_at(grid, truth, laser).astype(np.float32)
    scan = Scan(ranges, -math.pi, math.tau / 179, 0.1, 30.0, laser)
    return lambda pose: localisation.agreement_at(pose, scan)


def test_a_robot_killed_on_its_way_home_resumes_where_it_is() -> None:
    """It had driven 2 m since the last write and was near its start: amcl started at the initial pose, turned round."""
    correction = Correction(INITIAL, Pose(2.4, 0.3, -2.9))
    odom = Pose(0.35, 0.2, -1.9)
    assert not correction.applies_to(odom)
    assert has_continued(correction, Pose(1.5, 1.0, 1.57), odom, agreements(INITIAL.compose(odom)))


def test_odometry_that_was_restarted_elsewhere_is_told_by_the_scan() -> None:
    correction = Correction(Pose(0.2, 0.1, 0.3), Pose(1.2, 0.3, 0.2))
    odom = Pose(0.9, 0.1, 0.1)
    assert correction.applies_to(odom)
    assert not has_continued(correction, INITIAL, odom, agreements(INITIAL.compose(odom)))


def test_where_both_places_look_alike_the_odometry_decides() -> None:
    correction = Correction(Pose(), ODOM)
    assert has_continued(correction, INITIAL, ODOM, lambda _: 0.9)
    assert not has_continued(correction, INITIAL, Pose(), lambda _: 0.9)


def test_each_estimate_is_tried_once_where_the_file_cannot_be_written(tmp_path: Path) -> None:
    """An estimate lasts for several scans."""
    said: list[str] = []
    node = SimpleNamespace(
        _correction=CorrectionFile(str(tmp_path / "absent" / "correction")),
        _odom_frame="odom",
        _map_from_odom=Pose(),
        _kept=None,
        _unkept=SimpleNamespace(warn=said.append, end=lambda: None),
    )
    estimate = object()
    for _ in range(3):
        AmclNode._keep(node, estimate, ODOM)  # type: ignore[arg-type]
    assert len(said) == 1
    assert "absent" in said[0]


@pytest.mark.parametrize(("here", "place"), [(0.9, Pose(7.1)), (0.1, Pose(2.1))])
def test_amcl_starts_where_its_first_scan_fits(here: float, place: Pose) -> None:
    """That is where the robot has come by its odometry, from the remembered place or from the initial pose."""
    correction, odom = Correction(Pose(5.0, 0.0, 0.0), Pose(2.0, 0.0, 0.0)), Pose(2.1, 0.0, 0.0)
    placed: list[Pose] = []
    localisation = SimpleNamespace(
        agreement_at=lambda pose, _: here if pose.x > 5.0 else 0.5,
        set_pose=lambda pose, _: placed.append(pose),
    )
    node = SimpleNamespace(
        _localisation=localisation, _initial_pose=lambda: Pose(), _remembered=correction
    )
    node._config = AmclConfig()
    node._start_at = lambda pose: AmclNode._start_at(node, pose)  # type: ignore[arg-type]
    AmclNode._go_on(node, correction, odom, None)  # type: ignore[arg-type]
    assert placed == [place]
    assert node._remembered is None
