"""The fleets of this machine are found while they run, and only then."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_fleet.adapters.registry import Entry, running_fleets

KILLED = """
import os, signal
from pioneer_fleet.adapters.registry import Entry
Entry().write({"started": 1.0})
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    return tmp_path


def test_a_fleet_is_found_from_its_first_status_to_its_end() -> None:
    assert running_fleets() == []
    with contextlib.closing(Entry()) as entry:
        assert running_fleets() == []
        entry.write({"started": 2.0, "world": "blank"})
        assert running_fleets() == [{"started": 2.0, "world": "blank", "pid": os.getpid()}]
    assert running_fleets() == []


def test_a_fleet_that_was_killed_is_not_found_and_leaves_nothing(folder: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED], check=False, timeout=60)
    assert done.returncode == -signal.SIGKILL
    assert running_fleets() == []
    assert [path.name for path in folder.rglob("*.*")] == []
