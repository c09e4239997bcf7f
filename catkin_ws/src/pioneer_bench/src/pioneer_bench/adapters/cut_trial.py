"""A robot's host that disappears: the cable between two network namespaces is pulled."""

import time
from pathlib import Path

from pioneer_bench.adapters.fleet import PATIENCE, Fleet, Process, end, module_argv
from pioneer_bench.core.row import Row
from pioneer_harness.machine import FarMachine, MachineError
from pioneer_harness.masters import MasterProcess
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

WHAT = "link cut without a packet → far side unregistered"
GOAL = 10.0


def cut_rows(fleet: Fleet, folder: Path, repetitions: int) -> list[Row]:
    """Returns the times from pulling the cable until the base's master no longer lists the robot's publisher."""
    try:
        machine = FarMachine()
    except MachineError as error:
        return [Row(WHAT, "s", (), GOAL, remark=f"not measured: {error}")]
    try:
        with ProcessGroup() as group:
            samples = tuple(_cut(fleet, folder, machine, group, repetitions))
    finally:
        machine.close()
    return [Row(WHAT, "s", samples, GOAL)]


def _cut(fleet: Fleet, folder: Path, machine: FarMachine, group: ProcessGroup, repetitions: int) -> list[float]:
    with fleet.open_hub():
        master = MasterProcess(group, 11311, folder, machine.there, machine.prefix)
        uri = fleet.hub_uri.replace("127.0.0.1", machine.here)
        master.set_param(
            "/gateway", {"name": "far", "disable_uuids": True, "firewall": False, "insecure": True, "hub_uri": uri}
        )
        gateway = ["rosrun", "rocon_gateway", "gateway"]
        for name, argv in (("gateway", gateway), ("talk", module_argv("talk", "far", "/far", 100, 100, 10))):
            group.start(name, [*machine.prefix, *argv], master.environment, folder / f"far-{name}.log", may_end=True)
        fleet.base.ask("flip", "far", "subscriber", "/far")
        samples = []
        with fleet.base.running("hear", "/far") as ear:
            for _ in range(repetitions):
                _flows(ear)
                machine.unplug()
                cut = time.monotonic()
                wait_until(lambda: not fleet.base.publishers("/far"), "the far side is missed", PATIENCE)
                samples.append(time.monotonic() - cut)
                machine.plug()
            _flows(ear)
        fleet.base.ask("flip", "far", "subscriber", "/far", cancel=True)
        for pid in group.states():
            end(pid)
    return samples


def _flows(ear: Process) -> None:
    ear.first_after(time.monotonic())
