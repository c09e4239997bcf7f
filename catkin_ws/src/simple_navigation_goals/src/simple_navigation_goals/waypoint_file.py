"""Waypoints on disk: patrols, and the remaining waypoints from which a restarted client resumes."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from simple_navigation_goals.patrol import Patrol, PatrolError, patrol_from_mapping
from simple_navigation_goals.waypoint import Waypoint, WaypointError


class QueueFileError(ValueError):
    """The queue file cannot be read or written, or its content is invalid."""


def read_patrol(path: Path, frame: str) -> Patrol:
    """Returns the patrol in the YAML file at ``path``; ``frame`` applies unless the file names another.

    Raises:
        PatrolError: the file is missing, not YAML, or not a patrol; the message is one line that names the file.
    """
    try:
        return patrol_from_mapping(yaml.safe_load(path.read_text()), frame)
    except OSError as error:
        raise PatrolError(f"cannot read the patrol {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise PatrolError(
            f"the patrol {path} is not valid YAML: {' '.join(str(error).split())}"
        ) from None
    except PatrolError as error:
        raise PatrolError(f"the patrol {path}: {error}") from None


class Kept(NamedTuple):
    """What a client that has ended leaves to the next one."""

    waypoints: tuple[Waypoint, ...] = ()  #: those that remain, the current one first
    held: bool = (
        False  #: whether they wait for a new waypoint, because of a stop or of `on_abort: stop`
    )


class QueueFile:
    """The queue file at ``path``. With an empty path nothing is read or written."""

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None
        self._written = Kept()

    def read(self) -> Kept:
        """Returns what the file holds; no waypoints if there is no file.

        Raises:
            QueueFileError: the file cannot be read, or its content is invalid.
        """
        if self._path is None:
            return Kept()
        try:
            return _kept_from_json(json.loads(self._path.read_text()))
        except FileNotFoundError:
            return Kept()
        except (OSError, ValueError, KeyError, TypeError, WaypointError) as error:
            raise QueueFileError(f"{self._path} holds no waypoints: {error}") from None

    def write(self, waypoints: Sequence[Waypoint], held: bool = False) -> None:
        """Replaces the file atomically if what it has to hold differs from what was written last.

        Raises:
            QueueFileError: the file cannot be written.
        """
        kept = Kept(tuple(waypoints), held)
        if self._path is None or kept == self._written:
            return
        beside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            content = {"held": held, "waypoints": [asdict(waypoint) for waypoint in waypoints]}
            beside.write_text(json.dumps(content) + "\n")
            beside.replace(self._path)
        except OSError as error:
            raise QueueFileError(
                f"cannot remember the waypoints in {self._path}: {error}"
            ) from None
        self._written = kept


def _kept_from_json(content: Any) -> Kept:
    """Returns the content of a queue file; earlier versions wrote a list of waypoints."""
    fields = {"held": False, "waypoints": content} if isinstance(content, list) else content
    waypoints = tuple(Waypoint(**each) for each in fields["waypoints"])
    return Kept(waypoints, bool(fields["held"]))
