"""Reads scenarios from YAML files, or by name from those shipped with this package."""

import dataclasses
import hashlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import rospkg

from pioneer_demo.error import OptionError
from pioneer_demo.scenario.scenario import Scenario
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
        world = (
            file_named(said.world, path, "world") if said.world.endswith(".world") else said.world
        )
        navigation = file_named(said.navigation, path, "navigation")
        robots = (
            said.robots
            if isinstance(said.robots, int)
            else tuple(with_files(one, path) for one in said.robots)
        )
    except FleetFileError as error:
        raise DocumentError(str(error)) from None
    scenario = dataclasses.replace(said, world=world, navigation=navigation, robots=robots)
    try:
        _check_parameters(scenario)
        _check_places(scenario)
    except DocumentError as error:
        raise located(error, path, lines) from None
    return scenario


def _check_parameters(scenario: Scenario) -> None:
    """Checks the robots' navigation parameters, beside those that robots have from ``pioneer_2dnav``.

    Parameter files of the scenario's own may say anything else: then only the nodes can check.

    Raises:
        DocumentError: a name is unknown, or a value is refused.
    """
    own = {name: value for name, value in scenario.parameters.items() if not name.startswith("/")}
    robots = () if isinstance(scenario.robots, int) else scenario.robots
    if not own or scenario.navigation or any(robot.navigation for robot in robots):
        return
    # The import takes 0.2 s of CPU, which scenarios without parameters need not spend.
    from nav_bundle.check_parameters import faults, shipped_parameters

    for complaint in faults({**shipped_parameters(), **own}):
        # The first name in the text is the one at fault.
        wrong = re.search(r"~([\w/]+)", complaint)
        names = [name for name in own if wrong and name.endswith(f"/{wrong[1]}")]
        raise DocumentError(complaint, "parameters", *names[:1])


def _check_places(scenario: Scenario) -> None:
    """Checks given starts and goals on the world's map.

    Raises:
        DocumentError: a robot cannot be there, or cannot get there.
    """
    if isinstance(scenario.robots, int):
        return
    # Robots of other kinds have footprints of their own, which only their navigation knows.
    pioneers = not any(robot.description or robot.navigation for robot in scenario.robots)
    if (
        not pioneers
        or scenario.navigation
        or not any(robot.goals or robot.pose for robot in scenario.robots)
    ):
        return
    from pioneer_demo.scenario.map_file import floor_from_file
    from pioneer_demo.scenario.place import check_places

    floor = floor_from_file(map_files(scenario.world)[1])
    if floor is None:
        return
    starts = [
        (robot.pose["x"], robot.pose["y"]) if robot.pose else None for robot in scenario.robots
    ]
    goals = [[(goal[0], goal[1]) for goal in robot.goals] for robot in scenario.robots]
    check_places(floor.cropped(), starts, goals)


def digests(scenarios: Iterable[Scenario]) -> dict[str, str]:
    """Returns a digest of each file that the scenarios use: worlds, maps, descriptions and navigation parameters."""
    found: dict[str, str] = {}
    for scenario in scenarios:
        for path in _files(scenario):
            if path.is_file() and str(path) not in found:
                found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _files(scenario: Scenario) -> list[Path]:
    """Returns the paths of the files that a scenario names, and of its world's map."""
    world, description = map_files(scenario.world)
    files = [world, description, *description.parent.glob(f"{description.stem}.p[gn][mg]")]
    robots = () if isinstance(scenario.robots, int) else scenario.robots
    names = [scenario.navigation]
    for robot in robots:
        names += [robot.description, robot.navigation]
    return [*files, *(Path(name) for name in names if name)]


def map_files(world: str) -> tuple[Path, Path]:
    """Returns the paths of a world, given by its name or its file, and of its map's description."""
    if world.endswith(".world"):
        path = Path(world)
        return path, path.with_suffix(".yaml")
    package = Path(rospkg.RosPack().get_path("pioneer_gazebo"))
    return package / "worlds" / f"{world}.world", package / "map" / f"{world}.yaml"
