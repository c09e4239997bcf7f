from pathlib import Path
from types import SimpleNamespace

import pytest

from nav_bundle.adapters.correction_file import CorrectionFileError, read_correction, write_correction
from nav_bundle.core.pose import Pose
from nav_bundle.nodes.amcl import AmclNode


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "correction"
    write_correction(path, Pose(1.5, -2.25, 0.75), "odom")
    write_correction(path, Pose(1.0, -2.0, 0.5), "odom")
    assert read_correction(path, "odom") == Pose(1.0, -2.0, 0.5)
    assert list(tmp_path.iterdir()) == [path]


def test_of_another_robot_nothing_is_remembered(tmp_path: Path) -> None:
    path = tmp_path / "correction"
    write_correction(path, Pose(1.5, -2.25, 0.75), "pioneer1/odom")
    assert read_correction(path, "pioneer2/odom") is None


def test_no_file_is_no_memory(tmp_path: Path) -> None:
    assert read_correction(tmp_path / "correction", "odom") is None


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
    ],
)
def test_a_file_of_something_else_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "correction"
    path.write_text(text)
    with pytest.raises(CorrectionFileError, match="correction"):
        read_correction(path, "odom")


def test_amcl_starts_at_its_initial_pose_where_the_file_holds_something_else(tmp_path: Path) -> None:
    """It ended, and was started again every few seconds."""
    path = tmp_path / "correction"
    node = SimpleNamespace(_config=SimpleNamespace(correction_file=str(path)), _odom_frame="odom")
    path.write_text("")
    assert AmclNode._read_correction(node) is None  # type: ignore[arg-type]
    write_correction(path, Pose(1.0, -2.0, 0.5), "odom")
    assert AmclNode._read_correction(node) == Pose(1.0, -2.0, 0.5)  # type: ignore[arg-type]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CorrectionFileError, match="absent"):
        write_correction(tmp_path / "absent" / "correction", Pose(), "odom")
