"""Which deaths of nodes end a fleet."""

from pathlib import Path

import pytest

from pioneer_demo.adapters import processes
from pioneer_demo.adapters.processes import FleetProcesses
from pioneer_demo.core.option import DemoConfig, FleetConfig
from pioneer_harness.error import ProcessDiedError

DIED = "[{}-4] process has died [pid 42, exit code -9, cmd /ws/lib/{}].\n"
AGAIN = "[{}-4] restarting process\n"


def fleet(folder: Path, config: FleetConfig, **logs: str) -> FleetProcesses:
    """Returns a fleet of which nothing runs, with what two roslaunches have printed."""
    made = FleetProcesses(config)
    for name, text in logs.items():
        path = folder / name
        path.write_text(text)
        made._read[path] = 0
    return made


def test_a_node_that_is_started_again_is_one_line_in_a_fleet_and_the_end_of_a_demo(tmp_path: Path) -> None:
    text = DIED.format("pioneer1/amcl", "amcl") + AGAIN.format("pioneer1/amcl")
    with fleet(tmp_path, FleetConfig(), one=text) as running:
        assert running.check() == ["pioneer1/amcl has died and is started again"]
        assert running.check() == []
    with (
        fleet(tmp_path, DemoConfig(), one=DIED.format("pioneer1/amcl", "amcl")) as running,
        pytest.raises(ProcessDiedError, match="pioneer1/amcl"),
    ):
        running.check()


def test_a_node_that_stays_dead_ends_a_fleet_whatever_another_masters_node_of_its_name_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each master has a node called gateway."""
    text = DIED.format("gateway", "gateway.py")
    with fleet(tmp_path, FleetConfig(), one=text, two=text + AGAIN.format("gateway")) as running:
        assert running.check() == ["gateway has died and is started again"]
        monkeypatch.setattr(processes, "_RESTART", 0.0)
        with pytest.raises(ProcessDiedError, match="gateway"):
            running.check()
