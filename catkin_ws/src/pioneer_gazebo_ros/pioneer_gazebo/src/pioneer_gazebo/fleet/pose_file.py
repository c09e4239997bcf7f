"""Reads fleet files and files of initial poses, YAML with ``NAME: {x: …, y: …, a: …}``."""

from pathlib import Path
from typing import Any

import yaml

from pioneer_gazebo.fleet.fleet import FleetError
from pioneer_gazebo.world.resource import package_directory
from pioneer_node.adapters.fleet_file import read_fleet
from pioneer_node.core.fleet_file import FleetFileError, RobotEntry


def poses_of_world(world: str) -> Path:
    """Returns a world's poses file: ``pioneer_poses_WORLD.yaml`` if it exists, otherwise ``pioneer_poses.yaml``.

    Raises:
        FleetError: package pioneer_description is not found.
    """
    package = package_directory("pioneer_description")
    if package is None:
        raise FleetError("package pioneer_description, which has the initial poses, is not found")
    special = package / "config" / f"pioneer_poses_{world}.yaml"
    return special if special.is_file() else package / "config" / "pioneer_poses.yaml"


def read_poses(path: Path) -> dict[str, Any]:
    """Returns the file's content; only checks that it is a mapping.

    Raises:
        FleetError: it cannot be read or is not a mapping.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FleetError(f"{path}: cannot be read: {error}") from None
    if not isinstance(content, dict):
        raise FleetError(f"{path}: needs NAME: {{x: …, y: …, a: …}}")
    return content


def robots_of_file(path: str) -> tuple[RobotEntry, ...]:
    """Returns the robots of a fleet file.

    Raises:
        FleetError: the file is invalid.
    """
    try:
        return read_fleet(Path(path).expanduser())
    except FleetFileError as error:
        raise FleetError(str(error)) from None
