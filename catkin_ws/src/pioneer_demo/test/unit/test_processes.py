"""Which node deaths end a fleet."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from pioneer_demo.processes.command import Command, restarted_together, started_again
from pioneer_demo.processes.processes import FleetProcesses
from pioneer_demo.scenario.option import DemoConfig, FleetConfig
from pioneer_harness.error import ProcessDiedError
from pioneer_launch.process_report import NodeDeath, written


def died(name: str, respawns: bool = False, log: str = "") -> str:
    """Returns a line of a report: a node was killed."""
    return written(NodeDeath(name, 42, -9, log, respawns))


def fleet(folder: Path, config: FleetConfig, **reports: str) -> FleetProcesses:
    """Returns a fleet without running processes, with the reports of its roslaunches."""
    made = FleetProcesses(config)
    for name, text in reports.items():
        path = folder / f"{name}.deaths.jsonl"
        path.write_text(text)
        (folder / f"{name}.log").touch()
        made._read[path] = 0
    return made


def test_a_node_that_is_started_again_is_one_line_in_a_fleet_and_the_end_of_a_demo(
    tmp_path: Path,
) -> None:
    text = died("pioneer1/amcl", respawns=True)
    with fleet(tmp_path, FleetConfig(), one=text) as running:
        assert running.check() == ["pioneer1/amcl has died and is started again"]
        assert running.check() == []
    with (
        fleet(tmp_path, DemoConfig(), one=text) as running,
        pytest.raises(ProcessDiedError, match="pioneer1/amcl"),
    ):
        running.check()


def test_a_node_that_stays_dead_ends_a_fleet_whatever_another_masters_node_of_its_name_does(
    tmp_path: Path,
) -> None:
    """Each master has a node named gateway."""
    reports = {"one": died("gateway"), "two": died("gateway", respawns=True)}
    with (
        fleet(tmp_path, FleetConfig(), **reports) as running,
        pytest.raises(ProcessDiedError, match="gateway"),
    ):
        running.check()


def test_a_node_that_stays_dead_costs_its_robots_computer_only(tmp_path: Path) -> None:
    config = FleetConfig(robots=2, log=tmp_path)
    text = died("pioneer1/pioneer_ros")
    with fleet(tmp_path, config, **{"navigation-of-pioneer1": text}) as running:
        assert running.check() == []
        assert list(running.lost_computers) == ["navigation of pioneer1"]
        reason = running.lost_computers["navigation of pioneer1"]
        assert reason == "pioneer1/pioneer_ros (pid 42) has died, killed by SIGKILL"
        with pytest.raises(ProcessDiedError, match="killed by SIGKILL"):
            running.check(starting=True)


def test_half_a_line_of_a_report_is_read_once_it_is_whole(tmp_path: Path) -> None:
    text = died("pioneer1/amcl", respawns=True)
    with fleet(tmp_path, FleetConfig(), one=text[:20]) as running:
        assert running.check() == []
        with (tmp_path / "one.deaths.jsonl").open("a") as report:
            report.write(text[20:])
        assert running.check() == ["pioneer1/amcl has died and is started again"]


def test_a_robots_computer_starts_again_as_a_whole_and_the_base_station_ends_the_fleet() -> None:
    config = FleetConfig(robots=2)
    computer = ["aadi1_gateway", "navigation of pioneer1"]
    assert restarted_together(config, "aadi1_gateway") == computer
    assert restarted_together(config, "navigation of pioneer1") == computer
    assert restarted_together(config, "hub") == ["hub"]
    assert restarted_together(config, "Hub_Gateway") == []
    assert restarted_together(config, "simulator") == []
    assert restarted_together(DemoConfig(), "hub") == []
    for watcher in ("fleet page", "recorder"):
        assert restarted_together(DemoConfig(), watcher) == [watcher]


def test_a_recorder_that_starts_again_keeps_the_file_of_the_last_one(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    ended = Command("recorder", ("python3", "-m", "recorder", str(path), "a=b"), {})
    (tmp_path / "run-2.mcap").touch()
    again = ("python3", "-m", "recorder", str(tmp_path / "run-3.mcap"), "a=b")
    assert started_again(ended).argv == again
    assert started_again(Command("hub", ("x",), {})).argv == ("x",)


def test_a_node_that_keeps_dying_is_named_once_with_its_last_lines_and_the_fleet_continues(
    tmp_path: Path,
) -> None:
    node_log = tmp_path / "amcl.log"
    node_log.write_text("[rosout][FATAL]: ~odom_model_type must be diff or omni\nsignal_shutdown\n")
    text = died("pioneer1/amcl", respawns=True, log=str(node_log))
    with fleet(tmp_path, FleetConfig(), one=2 * text) as running:
        assert running.check() == 2 * ["pioneer1/amcl has died and is started again"]
        for count in (3, 4):
            with (tmp_path / "one.deaths.jsonl").open("a") as log:
                log.write(text)
            lines = running.check()
            assert [line.partition(";")[0] for line in lines] == ["pioneer1/amcl keeps dying"][
                count - 3 :
            ]
            assert all("~odom_model_type must be" in line for line in lines)
            (fault,) = running.faults()
            assert (
                f"{count} times so far, killed by SIGKILL: [rosout][FATAL]: ~odom_model_type must be"
                in fault
            )


def test_a_node_that_keeps_dying_ends_a_fleet_that_is_still_starting(tmp_path: Path) -> None:
    text = died("pioneer1/amcl", respawns=True)
    with (
        fleet(tmp_path, FleetConfig(), one=3 * text) as running,
        pytest.raises(ProcessDiedError, match="pioneer1/amcl keeps dying"),
    ):
        running.check(starting=True)


def test_a_full_disk_is_a_fault_while_it_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with fleet(tmp_path, FleetConfig(log=tmp_path)) as running:
        assert running.faults() == []
        monkeypatch.setattr(shutil, "disk_usage", lambda _folder: SimpleNamespace(free=4096))
        (fault,) = running.faults()
        assert fault == f"the disk with {tmp_path} is full: log lines and recordings are lost"
        monkeypatch.undo()
        assert running.faults() == []
