"""The page's recordings: what the user sees of a recorder that ends by itself."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.wait import START, wait_until
from pioneer_web.command.command import CommandError
from pioneer_web.command.recording import RecorderProcess, Recording
from pioneer_web.state.station import Station


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Returns the folder of a file system of 20 MB, of which recordings may take 4."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=20m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.fixture
def recording(disk: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recording]:
    with Master() as master:
        monkeypatch.setenv("ROS_MASTER_URI", master.uri)
        found = Recording(disk / "recordings", [f"base={master.uri}"])
        yield found
        found.close()


def test_a_recording_that_a_full_disk_ends_is_an_alert_until_the_next(
    recording: Recording, disk: Path
) -> None:
    recording.start()
    file = recording.file
    wait_until(lambda: Path(file).exists(), "the file", START)
    assert recording.fault == ""
    filler = disk / "filler"
    filler.write_bytes(bytes(6 * 2**20))
    fault = wait_until(lambda: recording.fault, "the recorder's end", START)
    assert fault == f"{file} ends after 0 messages: its disk has less than 16 MB free"
    assert recording.file == ""
    station = Station()
    station.recording_fault = fault
    station.watched_since = 0.0
    station.note_faults(1000.0, 1.7e9)
    (alert,) = station.values(1000.0)["alerts"]
    assert (alert["robot"], alert["what"], alert["until"]) == ("recording", fault, None)
    with pytest.raises(CommandError, match="its disk has less than 16 MB free"):
        recording.stop()
    filler.unlink()
    os.sync()
    recording.start()
    assert recording.fault == ""
    wait_until(lambda: Path(recording.file).exists(), "the next file", START)
    assert "0 messages, 0 dropped" in recording.stop()


TALKATIVE = """
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(print("the end") or 0))
for number in range(5000):
    print(f"line {number} of a hundred bytes".ljust(100), flush=True)
open(sys.argv[1], "w").close()
signal.pause()
"""


def test_a_recorder_that_prints_more_than_a_pipe_holds_is_not_stopped(tmp_path: Path) -> None:
    """Its output was read only at its end, so that it stood still after 64 KiB."""
    done = tmp_path / "done"
    process = RecorderProcess([sys.executable, "-c", TALKATIVE, str(done)])
    wait_until(done.exists, "half a megabyte of output", START)
    assert process.status is None
    assert process.end() == 0
    assert process.last_line == "the end"
