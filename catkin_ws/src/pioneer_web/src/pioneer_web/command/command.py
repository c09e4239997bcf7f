"""Operator commands: parses and validates the JSON that a page sends."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from pioneer_fleet.geometry import Pose

LONGEST = 10_000
"""Maximum length of a command's JSON [characters]."""
FARTHEST = 10_000.0
"""Maximum coordinate [m] and replay time [s]."""
SPACING = 1.2
"""Distance between the goals of robots that are sent as a group [m]."""
SIMULATOR_ACTIONS = ("pause", "resume", "step", "reset")


class CommandError(ValueError):
    """The command is invalid or not allowed; the message gives the reason."""


class Command(NamedTuple):
    """An operator's command: the name of what to do, and its arguments."""

    do: str
    arguments: Mapping[str, Any]


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
    do, on = fields.get("do"), fields.get("on") is True
    match do:
        case "drive":
            places = formation(_pose(fields), _robots(fields, robots))
            return Command("drive", {"places": places, "append": fields.get("append") is True})
        case "locate":
            (robot, *more) = _robots(fields, robots)
            if more:
                raise CommandError("an initial pose is for one robot")
            return Command("locate", {"robot": robot, "pose": _pose(fields)})
        case "cancel" | "stop" | "release":
            return Command(do, {"robots": _robots(fields, robots)})
        case "spawn":
            return Command("spawn", {"x": _number(fields, "x"), "y": _number(fields, "y")})
        case "simulate" if fields.get("action") in SIMULATOR_ACTIONS:
            return Command("simulate", {"action": fields["action"]})
        case "patrol":
            return Command("patrol", {"robots": _robots(fields, robots), "on": on})
        case "record":
            return Command("record", {"on": on})
        case "seek":
            return Command("seek", {"at": max(0.0, _number(fields, "at"))})
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
