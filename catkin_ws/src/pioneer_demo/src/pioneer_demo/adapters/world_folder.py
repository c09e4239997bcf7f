"""Which worlds there are, and how many robots each has a place for, by the folders of their maps and initial poses.

The standard library only: ``./pioneer up`` reads this too, on machines that have nothing but Python.
"""

import re
from pathlib import Path

_ROBOT = re.compile(r"^pioneer\d+:", re.M)
"""How a line of a file of initial poses begins; one robot's is one line."""


def map_names(folder: Path) -> list[str]:
    """Returns the names of the maps in ``folder``, sorted; none where there is no such folder."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def places_by_world(maps: Path, poses: Path) -> dict[str, int]:
    """Returns for each world that has a map in folder ``maps`` how many robots have an initial pose in it.

    Raises:
        OSError: as `place_count`.
    """
    return {world: place_count(poses, world) for world in map_names(maps)}


def place_count(poses: Path, world: str = "") -> int:
    """Returns how many robots have a pose in a world: by its own file in folder ``poses``, else by the common one.

    Raises:
        OSError: there is no common file.
    """
    own = poses / f"pioneer_poses_{world}.yaml"
    return len(_ROBOT.findall((own if own.is_file() else poses / "pioneer_poses.yaml").read_text()))
