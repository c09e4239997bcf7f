"""Reads scenarios from YAML files, or by name from those shipped with this package."""

import dataclasses
from pathlib import Path
from typing import Any

import rospkg

from pioneer_demo.core.error import OptionError
from pioneer_demo.core.scenario import Scenario
from pioneer_node.adapters.document import located, read_content
from pioneer_node.adapters.fleet_file import file_named, with_files
from pioneer_node.core.document import DocumentError, Place, built, nearest
from pioneer_node.core.fleet_file import FleetFileError


def scenario_folder() -> Path:
    """Returns the folder of the shipped scenarios."""
    return Path(rospkg.RosPack().get_path("pioneer_demo")) / "scenarios"


def scenario_path(name: Path) -> Path:
    """Returns the file of a scenario, given as a path or the name of a shipped scenario.

    Raises:
        OptionError: it does not exist; the message suggests the closest name.
    """
    if name.is_file():
        return name
    folder = scenario_folder()
    shipped = folder / f"{name.stem}.yaml"
    if name.parent == Path() and shipped.is_file():
        return shipped
    known = [path.stem for path in folder.glob("*.yaml")]
    raise OptionError(f"there is no scenario {name}; {nearest(name.stem, known)}")


def read_scenario(name: Path) -> Scenario:
    """Returns a scenario. File names in it, relative or ``package://…``, become absolute paths.

    Raises:
        OptionError: it cannot be read or is invalid; the message has file and line.
    """
    path = scenario_path(name)
    try:
        content, lines = read_content(path)
        return scenario_of(content, path, lines)
    except DocumentError as error:
        raise OptionError(str(error)) from None


def scenario_of(content: Any, path: Path, lines: dict[Place, int]) -> Scenario:
    """Returns the scenario described by the content of the file ``path``.

    Raises:
        DocumentError: it is invalid; the message has file and line.
    """
    try:
        said = built(Scenario, content, "a scenario")
    except DocumentError as error:
        raise located(error, path, lines) from None
    try:
        world = file_named(said.world, path, "world") if said.world.endswith(".world") else said.world
        navigation = file_named(said.navigation, path, "navigation")
        robots = said.robots if isinstance(said.robots, int) else tuple(with_files(one, path) for one in said.robots)
    except FleetFileError as error:
        raise DocumentError(str(error)) from None
    return dataclasses.replace(said, world=world, navigation=navigation, robots=robots)
