"""How fast rules take effect: after a call, a new publisher, a killed gateway, a restarted hub, or a cut cable."""

import itertools
import time
from pathlib import Path

from pioneer_bench.adapters.fleet import PATIENCE, Fleet, Process, module_argv
from pioneer_bench.core.row import Row
from pioneer_harness.machine import FarMachine, MachineError
from pioneer_harness.masters import MasterProcess
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

CUT = "link cut without a packet → far side unregistered"
CUT_GOAL = 10.0


def call_rows(fleet: Fleet, repetitions: int) -> list[Row]:
    """Returns the times from a call of flip or pull to the first message on the remote master."""
    fleet.robot.advertise("/called")
    samples: dict[str, list[float]] = {"flip": [], "pull": []}
    with (
        fleet.robot.running("talk", "called", "/called", 100, 100, 10),
        fleet.base.running("hear", "/called") as ear,
    ):
        wait_until(lambda: fleet.robot.publishers("/called"), "the publisher", PATIENCE)
        wait_until(
            lambda: "/called" in fleet.base.master.system_state()[1], "the subscriber", PATIENCE
        )
        for _ in range(repetitions):
            for action, kind in (("flip", "subscriber"), ("pull", "publisher")):
                asked = time.monotonic()
                fleet.base.ask(action, "robot", kind, "/called")
                samples[action].append(ear.first_after(asked))
                fleet.base.ask(action, "robot", kind, "/called", cancel=True)
                wait_until(lambda: not fleet.base.publishers("/called"), "the cancel", PATIENCE)
    return [
        Row(f"{action} call → first message far", "s", tuple(times), 0.3)
        for action, times in samples.items()
    ]


def publisher_rows(fleet: Fleet, repetitions: int) -> list[Row]:
    """Returns the times from the registration of a publisher that matches a rule to its first message far away."""
    rows = []
    for what, topic, rule in (
        ("exact name", "/exact", "/exact"),
        ("pattern", "/pattern1", "/patt.*"),
    ):
        fleet.base.ask("flip", "robot", "subscriber", rule)
        samples = []
        with fleet.base.running("hear", topic) as ear:
            wait_until(
                lambda t=topic: t in fleet.base.master.system_state()[1], "the subscriber", PATIENCE
            )
            for _ in range(repetitions):
                with fleet.robot.running("talk", "late", topic, 100, 100, 10) as talker:
                    wait_until(talker.times, "the registration", PATIENCE)
                    samples.append(ear.first_after(talker.times()[0]))
                wait_until(
                    lambda t=topic: not fleet.base.publishers(t), "the publisher's end", PATIENCE
                )
        fleet.base.ask("flip", "robot", "subscriber", rule, cancel=True)
        rows.append(Row(f"new publisher, {what} → first message far", "s", tuple(samples), 0.04))
    return rows


def fault_rows(fleet: Fleet, repetitions: int) -> list[Row]:
    """Returns the rows of a killed gateway, and of a hub that is killed and restarted."""
    fleet.base.ask("flip", "robot", "subscriber", "/kept")
    with (
        fleet.robot.running("talk", "kept", "/kept", 100, 100, 10),
        fleet.base.running("hear", "/kept") as ear,
    ):
        ear.first_after(0.0)
        noticed = []
        for _ in range(repetitions):
            noticed.append(_killed_gateway(fleet))
            ear.first_after(time.monotonic())
        restored, gaps = [], []
        for _ in range(repetitions):
            begin = time.monotonic()
            restored.append(_killed_hub(fleet))
            times = [moment for moment in ear.times() if moment > begin]
            gaps.append(max(late - early for early, late in itertools.pairwise(times)))
    fleet.base.ask("flip", "robot", "subscriber", "/kept", cancel=True)
    return [
        Row("gateway SIGKILL → far side unregistered, rule inactive", "s", tuple(noticed), 3.0),
        Row(
            "receiving gateway killed, started again → data",
            "s",
            _received_again(fleet, repetitions),
            0.2,
        ),
        Row("hub killed and back → all rules active", "s", tuple(restored), 2.0),
        Row("hub killed and back: longest gap of 100 Hz data", "s", tuple(gaps), 1.0),
    ]


def _killed_gateway(fleet: Fleet) -> float:
    fleet.robot.gateway.kill()
    died = time.monotonic()
    wait_until(lambda: not fleet.base.publishers("/kept"), "the far side notices", PATIENCE)
    wait_until(lambda: fleet.base.states() != ["active"], "the rule to become inactive", PATIENCE)
    noticed = time.monotonic() - died
    fleet.robot.start()
    return noticed


def _received_again(fleet: Fleet, repetitions: int) -> tuple[float, ...]:
    fleet.robot.ask("flip", "base", "publisher", "/sent")
    samples = []
    with (
        fleet.robot.running("talk", "sent", "/sent", 100, 100, 10),
        fleet.base.running("hear", "/sent") as ear,
    ):
        ear.first_after(0.0)
        for _ in range(repetitions):
            fleet.base.gateway.kill()
            began = time.monotonic()
            fleet.base.start()
            samples.append(ear.first_after(began))
    fleet.robot.ask("flip", "base", "publisher", "/sent", cancel=True)
    return tuple(samples)


def _killed_hub(fleet: Fleet) -> float:
    fleet.hub.kill()
    sites = (fleet.base, fleet.robot)
    wait_until(
        lambda: not any(site.is_connected() for site in sites), "the hub is missed", PATIENCE
    )
    fleet.start_hub()
    back = time.monotonic()
    wait_until(lambda: all(site.is_connected() for site in sites), "both on the hub", PATIENCE)
    wait_until(lambda: fleet.base.states() == ["active"], "all rules active", PATIENCE)
    return time.monotonic() - back


def cut_rows(fleet: Fleet, folder: Path, repetitions: int) -> list[Row]:
    """Returns the times from pulling the cable until the base's master no longer lists the robot's publisher."""
    try:
        machine = FarMachine()
    except MachineError as error:
        return [Row(CUT, "s", (), CUT_GOAL, remark=f"not measured: {error}")]
    try:
        with ProcessGroup() as group:
            samples = tuple(_cut(fleet, folder, machine, group, repetitions))
    finally:
        machine.close()
    return [Row(CUT, "s", samples, CUT_GOAL)]


def _cut(
    fleet: Fleet, folder: Path, machine: FarMachine, group: ProcessGroup, repetitions: int
) -> list[float]:
    with fleet.open_hub():
        master = MasterProcess(group, 11311, folder, machine.there, machine.prefix)
        uri = fleet.hub_uri.replace("127.0.0.1", machine.here)
        master.set_param(
            "/gateway",
            {
                "name": "far",
                "disable_uuids": True,
                "firewall": False,
                "insecure": True,
                "hub_uri": uri,
            },
        )
        gateway = ["rosrun", "rocon_gateway", "gateway"]
        for name, argv in (
            ("gateway", gateway),
            ("talk", module_argv("talk", "far", "/far", 100, 100, 10)),
        ):
            group.start(
                name,
                [*machine.prefix, *argv],
                master.environment,
                folder / f"far-{name}.log",
                may_end=True,
            )
        fleet.base.ask("flip", "far", "subscriber", "/far")
        samples = []
        with fleet.base.running("hear", "/far") as ear:
            for _ in range(repetitions):
                ear.first_after(time.monotonic())
                machine.unplug()
                cut = time.monotonic()
                wait_until(
                    lambda: not fleet.base.publishers("/far"), "the far side is missed", PATIENCE
                )
                samples.append(time.monotonic() - cut)
                machine.plug()
            ear.first_after(time.monotonic())
        fleet.base.ask("flip", "far", "subscriber", "/far", cancel=True)
        for pid in group.states():
            Process(pid).end()
    return samples
