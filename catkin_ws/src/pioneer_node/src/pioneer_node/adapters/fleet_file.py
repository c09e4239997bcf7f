"""Reads fleet files."""

import dataclasses
from pathlib import Path

import rospkg
import yaml

from pioneer_node.core.fleet_file import FleetFileError, RobotEntry, fleet_from_mapping


def read_fleet(path: Path) -> tuple[RobotEntry, ...]:
    """Returns the robots of a fleet file, with whole paths of the files that it names.

    Those are relative to the fleet file, or ``package://PACKAGE/…``.

    Raises:
        FleetFileError: it, or a file that it names, cannot be read or is wrong.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FleetFileError(f"cannot read the fleet file {path}: {error}") from None
    return tuple(
        dataclasses.replace(
            robot,
            description=_file(robot.description, path, robot.name),
            navigation=_file(robot.navigation, path, robot.name),
        )
        for robot in fleet_from_mapping(content, str(path))
    )


def _file(name: str, source: Path, robot: str) -> str:
    """Returns the whole path of a file that the fleet file names; empty stays empty."""
    if not name:
        return ""
    package, _, inside = name.removeprefix("package://").partition("/")
    try:
        folder = Path(rospkg.RosPack().get_path(package)) if name.startswith("package://") else source.resolve().parent
    except rospkg.ResourceNotFound:
        raise FleetFileError(f"{source}: {robot}: there is no package {package}") from None
    path = folder / (inside if name.startswith("package://") else Path(name).expanduser())
    if not path.is_file():
        raise FleetFileError(f"{source}: {robot}: there is no file {path}")
    return str(path)
