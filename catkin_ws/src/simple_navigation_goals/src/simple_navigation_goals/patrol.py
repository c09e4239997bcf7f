"""Patrols: lists of waypoints to drive to in rounds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pioneer_node.core.parameter import ParameterError
from simple_navigation_goals.waypoint import Waypoint, WaypointError

_FIELDS = ("frame", "loop", "waypoints")
_WAYPOINT_FIELDS = ("x", "y", "heading", "wait")


class PatrolError(ParameterError):
    """A patrol that cannot be read."""


@dataclass(frozen=True)
class Patrol:
    """Waypoints in order, and the number of rounds over all of them; ``rounds`` 0 repeats forever."""

    waypoints: tuple[Waypoint, ...]
    rounds: int = 1


def patrol_from_mapping(fields: Any, frame: str) -> Patrol:
    """Returns the patrol described by the content of a YAML file.

    ``waypoints``: a list of ``{x, y, heading, wait}`` in metres, degrees and seconds; ``heading`` and ``wait`` are
    optional. ``loop``: true (forever), a number of rounds, or false (one round; default). ``frame``: frame of the
    waypoints.

    Raises:
        PatrolError: the content is invalid; the message names the waypoint and the field.
    """
    _check_names(fields, _FIELDS, "a patrol")
    listed = fields.get("waypoints")
    if not isinstance(listed, list) or not listed:
        raise PatrolError("a patrol needs waypoints: a list of {x, y, heading, wait}")
    frame = str(fields.get("frame", frame)).strip("/")
    return Patrol(
        tuple(
            _waypoint(entry, frame, f"waypoint {number}") for number, entry in enumerate(listed, 1)
        ),
        _rounds(fields.get("loop", False)),
    )


def _rounds(loop: Any) -> int:
    if isinstance(loop, bool):
        return 0 if loop else 1
    if isinstance(loop, int) and loop >= 1:
        return loop
    raise PatrolError(f"loop must be true, false or a number of rounds, not {loop!r}")


def _waypoint(fields: Any, frame: str, what: str) -> Waypoint:
    _check_names(fields, _WAYPOINT_FIELDS, what)
    values = {}
    for name in _WAYPOINT_FIELDS:
        if name not in fields and name in ("x", "y"):
            raise PatrolError(f"{what} has no {name}")
        value = fields.get(name, 0.0)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise PatrolError(f"{what}: {name} must be a number, not {value!r}")
        values[name] = float(value)
    try:
        return Waypoint(
            values["x"], values["y"], math.radians(values["heading"]), frame, values["wait"]
        )
    except WaypointError as error:
        raise PatrolError(f"{what}: {error}") from None


def _check_names(fields: Any, known: tuple[str, ...], what: str) -> None:
    if not isinstance(fields, Mapping):
        raise PatrolError(f"{what} needs {', '.join(known)}, not {fields!r}")
    for name in fields:
        if name not in known:
            raise PatrolError(f"{what}: unknown field {name!r}; known: {', '.join(known)}")
