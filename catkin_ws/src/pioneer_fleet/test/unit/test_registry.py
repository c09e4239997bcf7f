"""The fleets of this machine are found while they run, and only then."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_fleet.registry import Entry, RegistryError, running_fleets

KILLED = """
import os, signal
from pioneer_fleet.registry import Entry
Entry().write({"started": 1.0})
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    return tmp_path


def test_a_fleet_is_found_from_its_first_status_to_its_end() -> None:
    assert running_fleets() == []
    with contextlib.closing(Entry()) as entry:
        assert running_fleets() == []
        entry.write({"started": 2.0, "world": "blank"})
        (found,) = running_fleets()
        assert 0.0 <= found.pop("age") < 60.0
        assert found == {"started": 2.0, "world": "blank", "pid": os.getpid()}
    assert running_fleets() == []


def test_a_fleet_that_was_killed_is_not_found_and_leaves_nothing(folder: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED], check=False, timeout=60)
    assert done.returncode == -signal.SIGKILL
    assert running_fleets() == []
    assert [path.name for path in folder.rglob("*.*")] == []


def test_the_next_fleet_removes_the_files_of_one_that_was_killed(folder: Path) -> None:
    """They used to stay until somebody asked for the status."""
    subprocess.run([sys.executable, "-c", KILLED], check=False, timeout=60)
    assert [path.suffix for path in folder.rglob("*.*")]
    Entry().close()
    assert [path.name for path in folder.rglob("*.*")] == []


def test_the_folder_of_the_session_is_preferred(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime = folder / "run"
    runtime.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    with contextlib.closing(Entry()) as entry:
        entry.write({"started": 2.0})
        assert [path.name for path in runtime.iterdir()] == ["pioneer-fleets"]
        assert len(running_fleets()) == 1


@pytest.mark.parametrize("fault", ["link", "mode", "owner", "file"])
def test_a_folder_that_others_can_reach_is_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    place = folder / f"pioneer-fleets-{os.getuid()}"
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir(0o700)
    (elsewhere / "1.lock").write_text("")
    if fault == "link":
        place.symlink_to(elsewhere)
    elif fault == "file":
        place.write_text("")
    else:
        place.mkdir(0o777 if fault == "mode" else 0o700)
        place.chmod(0o777 if fault == "mode" else 0o700)
    if fault == "owner":
        own = os.getuid()
        place.rename(folder / f"pioneer-fleets-{own + 1}")
        monkeypatch.setattr(os, "getuid", lambda: own + 1)
    with pytest.raises(RegistryError, match="must belong to this user"):
        Entry()
    assert running_fleets() == []
    assert [path.name for path in elsewhere.iterdir()] == ["1.lock"]


def test_a_file_of_a_fleet_is_not_written_through_a_link(folder: Path) -> None:
    precious = folder / "precious"
    precious.write_text("mine")
    place = folder / f"pioneer-fleets-{os.getuid()}"
    place.mkdir(0o700)
    for suffix in ("unlocked", "new", "json"):
        (place / f"{os.getpid()}.{suffix}").symlink_to(precious)
    with contextlib.closing(Entry()) as entry:
        entry.write({"started": 2.0})
        assert len(running_fleets()) == 1
    assert precious.read_text() == "mine"
