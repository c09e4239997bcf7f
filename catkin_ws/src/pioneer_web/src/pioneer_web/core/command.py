"""Operator commands: parses and validates the JSON that a page sends."""

import dataclasses
import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from pioneer_fleet.core.geometry import Pose

LONGEST = 10_000
"""Maximum length of a command's JSON [characters]."""
FARTHEST = 10_000.0
"""Maximum coordinate [m] and replay time [s]."""
SPACING = 1.2
"""Distance between the goals of robots that are sent as a group [m]."""
SIMULATOR_ACTIONS = ("pause", "resume", "step", "reset")


class CommandError(ValueError):
    """The command is invalid or not allowed; the message gives the reason."""


@dataclasses.dataclass(frozen=True)
class Drive:
    """Sends robots to waypoints, one per robot; ``append`` keeps the waypoints already queued."""

    places: Mapping[str, Pose]
    append: bool


@dataclasses.dataclass(frozen=True)
class Locate:
    """Sets a robot's initial pose for localisation."""

    robot: str
    pose: Pose


@dataclasses.dataclass(frozen=True)
class Cancel:
    """Cancels all waypoints of robots."""

    robots: Sequence[str]


@dataclasses.dataclass(frozen=True)
class Stop:
    """Stops and holds robots, or with ``release`` releases them."""

    robots: Sequence[str]
    release: bool = False


@dataclasses.dataclass(frozen=True)
class Spawn:
    """Spawns a box at (x, y) [m]."""

    x: float
    y: float


@dataclasses.dataclass(frozen=True)
class Simulate:
    """Runs one of ``SIMULATOR_ACTIONS``."""

    action: str


@dataclasses.dataclass(frozen=True)
class Patrol:
    """Makes robots repeat their current waypoints, or stops that if not ``on``."""

    robots: Sequence[str]
    on: bool


@dataclasses.dataclass(frozen=True)
class Record:
    """Starts a recording, or finishes it if not ``on``."""

    on: bool


@dataclasses.dataclass(frozen=True)
class Seek:
    """Seeks a replay to ``at`` [s] after its start."""

    at: float


Command = Drive | Locate | Cancel | Stop | Spawn | Simulate | Patrol | Record | Seek


def command_from_text(text: str, robots: Collection[str]) -> Command:
    """Returns the command in a page's JSON.

    Args:
        text: a JSON object whose ``do`` names the command.
        robots: names of the existing robots.

    Raises:
        CommandError: it is not a valid command.
    """
    if len(text) > LONGEST:
        raise CommandError(f"a command has at most {LONGEST} characters (got {len(text)})")
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        raise CommandError("a command must be JSON") from None
    if not isinstance(fields, dict):
        raise CommandError("a command must be a JSON object")
    match fields.get("do"):
        case "drive":
            places = formation(_pose(fields), _robots(fields, robots))
            return Drive(places, fields.get("append") is True)
        case "locate":
            (robot, *more) = _robots(fields, robots)
            if more:
                raise CommandError("an initial pose is for one robot")
            return Locate(robot, _pose(fields))
        case "cancel":
            return Cancel(_robots(fields, robots))
        case "stop" | "release" as word:
            return Stop(_robots(fields, robots), word == "release")
        case "spawn":
            return Spawn(_number(fields, "x"), _number(fields, "y"))
        case "simulate" if fields.get("action") in SIMULATOR_ACTIONS:
            return Simulate(str(fields["action"]))
        case "patrol":
            return Patrol(_robots(fields, robots), fields.get("on") is True)
        case "record":
            return Record(fields.get("on") is True)
        case "seek":
            return Seek(max(0.0, _number(fields, "at")))
    raise CommandError("unknown command")


def formation(place: Pose, robots: Sequence[str]) -> dict[str, Pose]:
    """Returns a goal for each robot, side by side on a line across the heading, centred on ``place``."""
    first = (len(robots) - 1) / 2
    return {
        robot: place.compose(Pose(0.0, SPACING * (first - number))) if len(robots) > 1 else place
        for number, robot in enumerate(robots)
    }


def _robots(fields: Mapping[str, Any], known: Collection[str]) -> list[str]:
    names = fields.get("robots")
    if not isinstance(names, list) or not names or len(names) > len(known):
        raise CommandError("'robots' must be a list of robots' names")
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise CommandError(f"unknown robot {str(name)[:40]!r}")
    return list(dict.fromkeys(names))


def _pose(fields: Mapping[str, Any]) -> Pose:
    yaw = _number(fields, "yaw") if "yaw" in fields else 0.0
    return Pose(_number(fields, "x"), _number(fields, "y"), math.remainder(yaw, math.tau))


def _number(fields: Mapping[str, Any], name: str) -> float:
    value = fields.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= FARTHEST:
        raise CommandError(f"'{name}' must be a number of at most {FARTHEST:g}")
    return float(value)
