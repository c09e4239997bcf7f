"""Reads fleet files."""

import dataclasses
from pathlib import Path
from typing import TypeVar

import rospkg
import yaml

from pioneer_node.core.fleet_file import (
    NO_NAVIGATION,
    FleetFileError,
    RobotEntry,
    fleet_from_mapping,
)

Entry = TypeVar("Entry", bound=RobotEntry)


def read_fleet(path: Path) -> tuple[RobotEntry, ...]:
    """Returns the robots of a fleet file, with the absolute paths of the files it names.

    File names are relative to the fleet file, or ``package://PACKAGE/…``.

    Raises:
        FleetFileError: the file is unreadable or invalid, or a file it names does not exist.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise FleetFileError(f"cannot read the fleet file {path}: {error.strerror}") from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise FleetFileError(f"cannot read the fleet file {path}: {error}") from None
    return tuple(with_files(robot, path) for robot in fleet_from_mapping(content, str(path)))


def with_files(robot: Entry, source: Path) -> Entry:
    """Returns the robot with the file names from ``source`` resolved to absolute paths.

    Raises:
        FleetFileError: a file does not exist.
    """
    return dataclasses.replace(
        robot,
        description=file_named(robot.description, source, robot.name),
        navigation=(
            robot.navigation
            if robot.navigation == NO_NAVIGATION
            else file_named(robot.navigation, source, robot.name)
        ),
    )


def file_named(name: str, source: Path, owner: str) -> str:
    """Returns the absolute path of a file that ``source`` names for ``owner``; empty stays empty.

    Raises:
        FleetFileError: the file or its package does not exist.
    """
    if not name:
        return ""
    package, _, inside = name.removeprefix("package://").partition("/")
    try:
        folder = (
            Path(rospkg.RosPack().get_path(package))
            if name.startswith("package://")
            else source.resolve().parent
        )
    except rospkg.ResourceNotFound:
        raise FleetFileError(f"{source}: {owner}: there is no package {package}") from None
    path = folder / (inside if name.startswith("package://") else Path(name).expanduser())
    if not path.is_file():
        raise FleetFileError(f"{source}: {owner}: there is no file {path}")
    return str(path)
