"""Reports of deaths, also where the disk is full."""

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pioneer_harness.wait import wait_until
from pioneer_launch import process_report
from pioneer_launch.process_report import Listener, NodeDeath, begin_report, deaths_in, written

PATIENCE = 20.0


class Monitor:
    """A process monitor of roslaunch with one node, which has died some times."""

    def __init__(self) -> None:
        self.node = SimpleNamespace(spawn_count=1, pid=42, respawn=True, required=False)

    def get_process(self, _name: str) -> Any:
        return self.node


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, which can be filled."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def names_in(report: Path) -> list[str]:
    return [death.name for death in deaths_in(report.read_text())]


def test_a_death_on_a_full_disk_is_in_the_report(small_disk: Path) -> None:
    """move_base ended there and was started again, and nobody said it."""
    report = small_disk / "report"
    begin_report(report)
    with (small_disk / "filler").open("wb", buffering=0) as filler, contextlib.suppress(OSError):
        while filler.write(bytes(1 << 12)):
            continue
    other = small_disk / "other"
    with contextlib.suppress(OSError), other.open("wb", buffering=0) as file:
        file.write(b"x")
    assert other.stat().st_size == 0
    assert report.read_bytes() == b""
    listener = Listener(Monitor(), report)
    listener.process_died("pioneer1/move_base-2", 1)
    assert names_in(report) == ["pioneer1/move_base"]


def test_a_death_that_cannot_be_written_is_reported_once_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The exception made roslaunch's monitor forget the node."""
    monkeypatch.setattr(process_report, "RETRY", 0.05)
    monitor, report = Monitor(), tmp_path / "report"
    report.mkdir()  # nothing can be appended to a folder
    listener = Listener(monitor, report)
    listener.process_died("amcl-1", -9)
    listener.process_died("amcl-1", -9)
    monitor.node.spawn_count = 2
    listener.process_died("amcl-1", -9)
    report.rmdir()
    wait_until(report.is_file, "the report", PATIENCE)
    wait_until(lambda: len(names_in(report)) == 2, "both deaths", PATIENCE)
    monitor.node.spawn_count = 3
    listener.process_died("amcl-1", -9)
    assert names_in(report) == ["amcl", "amcl", "amcl"]


def test_a_line_that_was_cut_costs_no_other() -> None:
    """A full disk and the launcher's end had left half a line, which ended the fleet's command."""
    line = written(NodeDeath("pioneer1/amcl", 7, -9, "", True))
    assert [death.pid for death in deaths_in(f"{line[:20]}{line}{line}")] == [7]
