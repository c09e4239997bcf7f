"""What an operator may ask for: checked values from the JSON that a page sends."""

import dataclasses
import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from pioneer_fleet.core.geometry import Pose

LONGEST = 10_000
"""Of a command's JSON [characters]."""
FARTHEST = 10_000.0
"""Largest coordinate [m], and time in a replay [s]."""
SPACING = 1.2
"""Between the places of robots that are sent as a group [m]."""
SIMULATOR_ACTIONS = ("pause", "resume", "step", "reset")


class CommandError(ValueError):
    """A command that is not understood, or not allowed; the text says why."""


@dataclasses.dataclass(frozen=True)
class Drive:
    """Waypoints, one a robot; ``append`` leaves those that the robot has."""

    places: Mapping[str, Pose]
    append: bool


@dataclasses.dataclass(frozen=True)
class Locate:
    """Where a robot is, for its localisation."""

    robot: str
    pose: Pose


@dataclasses.dataclass(frozen=True)
class Cancel:
    """Robots whose waypoints are dropped."""

    robots: Sequence[str]


@dataclasses.dataclass(frozen=True)
class Stop:
    """Robots to stop and hold, or with ``release`` to let go."""

    robots: Sequence[str]
    release: bool = False


@dataclasses.dataclass(frozen=True)
class Spawn:
    """Where a box is put [m]."""

    x: float
    y: float


@dataclasses.dataclass(frozen=True)
class Simulate:
    """One of ``SIMULATOR_ACTIONS``."""

    action: str


@dataclasses.dataclass(frozen=True)
class Patrol:
    """Robots that repeat the waypoints that they have; without ``on`` no longer."""

    robots: Sequence[str]
    on: bool


@dataclasses.dataclass(frozen=True)
class Record:
    """Begins a recording, or without ``on`` completes it."""

    on: bool


@dataclasses.dataclass(frozen=True)
class Seek:
    """Where a replay continues [s], after its begin."""

    at: float


Command = Drive | Locate | Cancel | Stop | Spawn | Simulate | Patrol | Record | Seek


def command_from_text(text: str, robots: Collection[str]) -> Command:
    """Returns the command in a page's JSON.

    Args:
        text: an object whose ``do`` says which command it is.
        robots: the names that exist.

    Raises:
        CommandError: it is none.
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
    """Returns a place for each robot: one after the other on a line across the heading, centred on ``place``."""
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
