"""Measures a hub with a thousand gateways."""

import contextlib
import time
from pathlib import Path

from pioneer_bench.adapters.fleet import PATIENCE, Fleet, cpu, family
from pioneer_bench.core.row import Row
from pioneer_harness.wait import wait_until

SIZE, RULES, CHANGES = 1000, 20, 20

CROWD_PATIENCE = 180.0
"""Time-out for the whole run of the crowd until it is ready [s]; longer than the crowd's own time-out."""

SETTLING = 20.0
"""Redis frees the buffer of an idle connection after 3 s; its allocator returns the memory 10 s later [s]."""


def password_rows(folder: Path) -> list[Row]:
    """Returns the same rows for a hub that requires proof of its password on every connection."""
    with contextlib.closing(Fleet(folder, ROCON_HUB_PASSWORD="bench")) as fleet:
        fleet.start()
        return crowd_rows(fleet, " with a password")


def crowd_rows(fleet: Fleet, how: str = "") -> list[Row]:
    """Returns the rows of a thousand simulated gateways on a real hub, beside the two real ones."""
    name = f"hub with {SIZE:,} gateways × {RULES} rules{how}"
    with fleet.base.running("crowd", fleet.port, SIZE, RULES, CHANGES) as crowd:
        before = _cpu(fleet)
        wait_until(
            lambda: "ready" in crowd.lines() or not crowd.lives,
            "the crowd's convergence",
            CROWD_PATIENCE,
        )
        said = [line.split() for line in crowd.lines()]
        spent = _cpu(fleet) - before
        joining = _resident(fleet)
        called = [_flip(fleet, number) for number in range(3)] if "ready" in crowd.lines() else []
        # Not a wait for a condition: memory is measured after a period in which no gateway joins.
        time.sleep(SETTLING)
        settled = _resident(fleet)
        held = crowd.lives
    converged = tuple(float(words[1]) for words in said if words[0] == "converged")
    changes = tuple(float(words[1]) for words in said if words[0] == "change")
    remark = "" if held else "the crowd was lost"
    return [
        Row(f"{name}: all rules answered", "s", converged, 30.0, remark=remark),
        Row(f"{name}: CPU of hub and Redis until then", "s", (spent,)),
        Row(f"{name}: a change → the peer's answer", "s", changes, 0.5),
        Row(f"{name}: flip call → first message far", "s", tuple(called), 0.5),
        Row(f"{name}: memory of hub and Redis", "MB", (settled,) if held else (), 100.0),
        Row(f"{name}: the same while all join", "MB", (joining,)),
    ]


def _cpu(fleet: Fleet) -> float:
    return cpu([one.pid for one in family(fleet.hub.pid)])


def _resident(fleet: Fleet) -> float:
    return sum(one.rss for one in family(fleet.hub.pid)) / 1e6


def _flip(fleet: Fleet, number: int) -> float:
    topic = f"/crowded{number}"
    with (
        fleet.robot.running("talk", "crowded", topic, 100, 100, 10),
        fleet.base.running("hear", topic) as ear,
    ):
        wait_until(lambda: fleet.robot.publishers(topic), "the publisher", PATIENCE)
        wait_until(lambda: topic in fleet.base.master.system_state()[1], "the subscriber", PATIENCE)
        asked = time.monotonic()
        fleet.base.ask("flip", "robot", "subscriber", topic)
        took = ear.first_after(asked)
        fleet.base.ask("flip", "robot", "subscriber", topic, cancel=True)
    return took
