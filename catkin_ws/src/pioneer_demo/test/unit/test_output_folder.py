"""Each output folder belongs to one running command."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_demo.console.output_folder import FolderLock
from pioneer_demo.error import FolderInUseError, OptionError
from pioneer_demo.main import _check_files, _made_output
from pioneer_demo.scenario.option import DemoConfig, FleetConfig
from pioneer_node.core.fleet_file import RobotEntry

HOLDER = """
import sys
from pathlib import Path
from pioneer_demo.console.output_folder import FolderLock
lock = FolderLock(Path(sys.argv[1]))
print("locked", flush=True)
sys.stdin.read()
"""


def test_a_folder_in_use_names_the_process_that_uses_it(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    argv = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(argv, env=environment, stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(
            FolderInUseError, match=f"is in use by process {other.pid}: wait for its end"
        ):
            FolderLock(tmp_path)
        other.kill()
        other.wait()
        FolderLock(tmp_path).release()  # a killed command holds no lock


def test_a_second_fleet_in_a_folder_gets_its_own_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = []
    locks = []
    for _ in range(3):
        config, lock = _made_output(FleetConfig())
        names.append(str(config.log))
        locks.append(lock)
    assert names == ["fleet-log", "fleet-log-2", "fleet-log-3"]
    pid = os.getpid()
    assert capsys.readouterr().out.splitlines()[0] == (
        f"fleet-log is in use by process {pid}: this log goes to fleet-log-2"
    )
    for lock in locks:
        lock.release()
    config, lock = _made_output(FleetConfig())
    lock.release()
    assert str(config.log) == "fleet-log"


def test_a_second_run_of_a_scenario_reads_its_own_fleet_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    entries = (RobotEntry(name="a"),)
    configs = []
    locks = []
    for _ in range(2):
        config, lock = _made_output(DemoConfig(entries=entries))
        configs.append(config)
        locks.append(lock)
    assert [str(config.report) for config in configs] == ["demo-report", "demo-report-2"]
    assert isinstance(configs[1], DemoConfig)
    assert configs[1].fleet == tmp_path / "demo-report-2" / "log" / "fleet.yaml"
    assert "name: a" in configs[1].fleet.read_text()
    for lock in locks:
        lock.release()


def test_a_given_folder_in_use_is_refused(tmp_path: Path) -> None:
    config = FleetConfig(log=tmp_path / "logs")
    with (
        FolderLock(config.log),
        pytest.raises(OptionError, match=r"--log: .*logs is in use by process"),
    ):
        _made_output(config)


def test_a_recording_replaces_a_file_only_when_told_to(tmp_path: Path) -> None:
    config = FleetConfig(record=tmp_path / "run.mcap")
    _check_files(config)
    (tmp_path / "run.mcap").touch()
    with pytest.raises(
        OptionError, match=r"--record: there is a file .*run\.mcap; --force replaces it"
    ):
        _check_files(config)
    _check_files(dataclasses.replace(config, force=True))
