"""Lists the available worlds and their initial poses, from the folders of maps and poses.

Uses only the standard library: ``./pioneer up`` imports this on machines with nothing but Python.
"""

import re
from pathlib import Path

_ROBOT = re.compile(r"^pioneer\d+:", re.M)
"""Matches the start of a robot's line in a file of initial poses; one line per robot."""


def map_names(folder: Path) -> list[str]:
    """Returns the sorted names of the maps in ``folder``; empty if it does not exist."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def places_by_world(maps: Path, poses: Path) -> dict[str, int]:
    """Returns the number of initial poses of each world that has a map in folder ``maps``.

    Raises:
        OSError: see `place_count`.
    """
    return {world: place_count(poses, world) for world in map_names(maps)}


def place_count(poses: Path, world: str = "") -> int:
    """Returns the number of initial poses in a world, from its own file in folder ``poses`` or else the common file.

    Raises:
        OSError: the common file is needed but does not exist.
    """
    return len(_ROBOT.findall(poses_of(poses, world).read_text()))


def poses_of(poses: Path, world: str) -> Path:
    """Returns the file of initial poses of a world in folder ``poses``: its own, or else the common one."""
    own = poses / f"pioneer_poses_{world}.yaml"
    return own if own.is_file() else poses / "pioneer_poses.yaml"
