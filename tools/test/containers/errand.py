"""Robots on errands, each observed by its own computer, for tests of the effects of faults."""

import json
import math
import re
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from tested_fleet import PATIENCE, Fleet

from containers.engine import Computer
from containers.report import REPORT
from pioneer_harness.wait import wait_until

ROUNDS: dict[int, tuple[tuple[float, float], ...]] = {
    1: ((-4.0, -8.5), (-4.0, -12.0), (-2.0, -10.0)),
    2: ((-4.0, 19.5), (-4.0, 16.5), (-2.0, 18.0)),
    3: ((2.0, 2.0), (2.0, -0.5), (5.0, 1.0)),
    4: ((17.0, -11.0), (17.0, -8.0), (21.0, -11.0)),
    5: ((5.0, -11.0), (5.0, -7.5), (2.5, -11.0)),
    6: ((-2.0, 8.0), (-4.0, 6.5), (-3.5, 9.5)),
}
"""Per robot, a round of 8 to 12 m through the room of utm_0 in which it starts, and back to its start."""

WALLS = {1: (-4.3, -12.3), 2: (-4.9, 16.5), 3: (2.0, -0.9), 4: (16.1, -8.0), 5: (5.0, -6.1)}
"""Per robot, a place in its room 1.1 m from a wall: a local costmap, 1.5 m to each side, has costs there. The rounds
alone stay up to 2.5 m away from walls, and RViz draws free space without colour."""
ROUND, ACROSS = slice(None), slice(1, 2)
"""A whole round; only its middle, which is far from its start and end and from its first place."""

ODOM_GAP, SCAN_GAP = 0.5, 1.0
"""A robot of this fleet stops after this time without odometry (move_base's odom_timeout); scans come at a tenth of
odometry's rate. Both in [s] of simulated time, which a busy machine only slows down."""

NEAR = 0.4
"""A robot is at a place below this distance [m]: goal tolerance plus localisation error."""

Report = Mapping[str, Any]


class Errand:
    """One robot's round, and its computer's reports meanwhile."""

    def __init__(self, computer: Computer, places: Sequence[tuple[float, float]]) -> None:
        self.name, self._count, self._computer = computer.name, len(places), computer
        self._began = time.time()
        words = [
            "--until",
            "ready",
            "--timeout",
            f"{PATIENCE:g}",
            *(f"--to={x},{y}" for x, y in places),
        ]
        self._process = subprocess.Popen(
            [
                *computer.docker,
                "exec",
                computer.container,
                *REPORT,
                "--robot",
                computer.robot,
                *words,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._changed = threading.Condition()
        self._reports: list[Report] = []
        self._other: list[str] = []
        self._over = False
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None, "it was asked for"
        with self._process.stdout as lines:
            for line in lines:
                with self._changed:
                    if line.startswith("{"):
                        self._reports.append(json.loads(line))
                    else:
                        self._other.append(line)
                    self._changed.notify_all()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def under_way(self) -> Report:
        """Waits until the robot drives; returns the first report in which it was ready for the errand."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or self._find("moving"), PATIENCE)
            assert self._find("moving"), f"{self.name} does not drive: {self._last()}"
            found = self._find("ready", "moving")
            assert found is not None, "it moves"
            return found

    def _find(self, *stages: str) -> Report | None:
        return next((report for report in self._reports if report["stage"] in stages), None)

    def _last(self) -> Report | str:
        return self._reports[-1] if self._reports else "".join(self._other)

    def over(self) -> Report:
        """Waits until every place of the round has been reached or aborted; returns the last report."""
        status = self._process.wait(PATIENCE + 30.0)
        self._thread.join()
        assert status == 0, f"{self.name} has not dealt with its waypoints: {self._last()}"
        return self._reports[-1]

    def reached(self) -> None:
        """Checks that the robot reaches every place of its round."""
        before, after = self.under_way(), self.over()
        assert after["reached"] - before["reached"] == self._count, self._told(after)
        assert after["aborted"] == before["aborted"], self._told(after)

    def undisturbed(self) -> None:
        """Like `reached`, with all rules in force at the end and no gap in the data above the robot's limit."""
        self.reached()
        after = self.over()
        assert after["active"] == after["rules"], self._told(after)
        assert after["odom_gap"] <= ODOM_GAP, self._told(after)
        assert after["scan_gap"] <= SCAN_GAP, self._told(after)

    def _told(self, report: Report) -> str:
        """Returns a report, followed by the computer's log since the errand began."""
        command = [
            *self._computer.docker,
            "logs",
            "--since",
            f"{self._began:.0f}",
            "--tail",
            "12",
            self._computer.container,
        ]
        said = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        return f"{self.name}: {report}\n{said.stdout}"

    def abandon(self) -> None:
        """Stops observing a computer that no longer exists, or after a failed test."""
        self._process.kill()
        self._process.wait()
        self._thread.join()


class Errands:
    """The errands of a fleet; those that a test leaves unfinished are abandoned."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet  #: the fleet whose robots are sent
        self.sent: list[Errand] = []  #: all errands so far

    def send(self, *numbers: int, part: slice = ROUND, wall: bool = False) -> dict[int, Errand]:
        """Sends robots on their rounds or a ``part`` of them, first to a wall if ``wall``; returns once all drive."""
        computers = self.fleet.computers()
        errands = {
            number: Errand(
                computers[f"aadi{number}"],
                [*([WALLS[number]] if wall else []), *ROUNDS[number][part]],
            )
            for number in numbers
        }
        self.sent += errands.values()
        for errand in errands.values():
            errand.under_way()
        return errands

    def close(self) -> None:
        """Abandons all errands."""
        for errand in self.sent:
            errand.abandon()


def place(fleet: Fleet, number: int) -> tuple[float, float]:
    """Returns a robot's position in the simulator [m]."""
    model = f"{{model_name: pioneer{number}}}"
    said = fleet.execute("aadiworkstation", "rosservice", "call", "/gazebo/get_model_state", model)
    x, y = (float(word) for word in re.findall(r"position:\s*x: (\S+)\s*y: (\S+)", said)[0])
    return x, y


def finishes(fleet: Fleet, number: int, part: slice = ROUND) -> None:
    """Checks that a robot ends its round, or the ``part`` of it, with waypoints that are not sent again."""
    end = ROUNDS[number][part][-1]
    wait_until(
        lambda: math.dist(place(fleet, number), end) < NEAR, f"pioneer{number} at {end}", PATIENCE
    )
    wait_until(lambda: _is_idle(fleet, number), f"an empty queue of pioneer{number}", PATIENCE)


def _is_idle(fleet: Fleet, number: int) -> bool:
    report = fleet.report(f"aadi{number}", "--until", "ready")
    return bool(report["reached"] == report["received"])
