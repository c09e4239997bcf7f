"""``./pioneer check FILE…``: reads files with the readers of the nodes that use them, and prints what these say."""

import argparse
import dataclasses
import json
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

ABOUT = """\
Says of each file what is taken, what is left out and why. The files are read with the readers of the nodes:
worlds (.world, .sdf), robots (.urdf, .xacro), maps, scenarios, fleet files, and YAML of move_base, amcl and
slam_gmapping. YAML of navigation is read together, as the parameters of one robot."""
EPILOG = """\
exit status: 0 if all files can be used, 1 if one cannot (with --strict also if something is left out),
2 for wrong options.

example: ./pioneer check costmap_common_params.yaml local_costmap_params.yaml my.world"""
_XACRO_TIMEOUT = 60.0
_SCENARIO = frozenset(
    ("world", "waypoints", "faults", "success", "rounds", "seed", "limit", "parameters", "lockstep")
)
"""Fields of scenarios that no other file has."""
Lines = dict[tuple[str, ...], int]


class RefusedError(Exception):
    """A file cannot be used; the message has the reason."""


@dataclasses.dataclass
class Note:
    """Something about a file: why it is refused, or what is left out of it."""

    text: str
    line: int | None = None  #: in the file; None if the reader knows none


@dataclasses.dataclass
class Report:
    """What the readers say of a file."""

    file: str
    kind: str = "unknown"
    taken: str = ""  #: what it holds, in a few words
    refused: list[Note] = dataclasses.field(default_factory=list)  #: why it cannot be used
    warnings: list[Note] = dataclasses.field(
        default_factory=list
    )  #: what is left out or taken as another value, and why

    def refuse(self, text: str) -> None:
        """Adds the reason why the file cannot be used; the text may name the line."""
        self.refused.append(Note(text, line_in(text, self.file)))

    def warn(self, text: str) -> None:
        """Adds a warning; the text may name the line."""
        self.warnings.append(Note(text, line_in(text, self.file)))


def line_in(text: str, file: str) -> int | None:
    """Returns the line of ``file`` that a message names as ``FILE:LINE`` or ``FILE, line LINE``; None if none."""
    found = re.search(re.escape(file) + r"(?::|, line )(\d+)", text)
    return int(found[1]) if found else None


def parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    found = argparse.ArgumentParser(
        prog="./pioneer check",
        description=ABOUT,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    found.add_argument("files", nargs="+", metavar="FILE", type=Path)
    found.add_argument("--json", action="store_true", help="as JSON, for programs")
    found.add_argument(
        "--strict", action="store_true", help="exit with 1 also if something is left out"
    )
    return found


def main(words: Sequence[str] | None = None) -> int:
    """Checks files; returns the exit status."""
    options = parser().parse_args(words)
    reports = check(options.files)
    if options.json:
        print(json.dumps([dataclasses.asdict(report) for report in reports], indent=2))
    else:
        for report in reports:
            print(text_of(report))
    failed = any(report.refused or (options.strict and report.warnings) for report in reports)
    return 1 if failed else 0


def check(files: Sequence[Path]) -> list[Report]:
    """Returns a report of each file, in their order."""
    reports = [Report(str(file)) for file in files]
    parameters: list[tuple[Report, Any]] = []
    for file, report in zip(files, reports, strict=True):
        if not file.is_file():
            report.refuse("there is no such file")
        elif file.suffix.lower() in (".yaml", ".yml"):
            _check_yaml(file, report, parameters)
        else:
            _guarded(_check_xml, file, report)
    _check_parameters(parameters)
    return reports


def text_of(report: Report) -> str:
    """Returns a report as lines of text."""
    state = "refused" if report.refused else "taken, with warnings" if report.warnings else "taken"
    taken = f" ({report.taken})" if report.taken else ""
    lines = [f"{report.file}: {report.kind}{taken}: {state}"]
    for word, notes in (("error", report.refused), ("warning", report.warnings)):
        lines += [
            f"  {f'line {note.line}: ' if note.line else ''}{word}: {note.text}" for note in notes
        ]
    return "\n".join(lines)


def _guarded(read: Callable[[Path, Report], None], file: Path, report: Report) -> None:
    """Calls a reader; its error is why the file is refused."""
    from nav_bundle.base.error import NavigationError
    from pioneer_demo.error import DemoError
    from pioneer_gazebo.error import SimulatorError
    from pioneer_node.core.parameter import ParameterError

    try:
        read(file, report)
    except (NavigationError, DemoError, SimulatorError, ParameterError, RefusedError) as error:
        report.refuse(str(error))
    except OSError as error:
        report.refuse(f"cannot be read: {error.strerror or error}")


def _check_xml(file: Path, report: Report) -> None:
    text = file.read_bytes()
    if file.suffix.lower() == ".xacro":
        report.kind = "robot"
        text = _expanded(file)
    if file.suffix.lower() in (".xacro", ".urdf") or b"<robot" in text:
        _check_robot(text, file, report)
    else:
        _check_world(file, report)


def _expanded(file: Path) -> bytes:
    """Returns the URDF that the workspace's xacro makes of a file."""
    try:
        done = subprocess.run(
            ["xacro", str(file)], capture_output=True, timeout=_XACRO_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise RefusedError(f"xacro did not end within {_XACRO_TIMEOUT:.0f} s") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise RefusedError(f"xacro: {said[-1] if said else f'exit status {done.returncode}'}")
    return done.stdout


def _check_robot(text: bytes, file: Path, report: Report) -> None:
    from pioneer_gazebo.world.mesh import prepare
    from pioneer_gazebo.world.urdf import robot_from_urdf

    report.kind = "robot"
    # Lines of the URDF that xacro makes are not those of the file.
    source = "the expanded URDF" if file.suffix.lower() == ".xacro" else str(file)
    robot = robot_from_urdf(text, source)
    prepare(robot.links, robot.static, lambda _: None)
    report.taken = f"{robot.name}: {len(robot.links)} links, {len(robot.joints)} joints, {len(robot.devices)} devices"
    for line in robot.warnings:
        report.warn(line)


def _check_world(file: Path, report: Report) -> None:
    from pioneer_gazebo.world.mesh import prepare
    from pioneer_gazebo.world.resource import model_path
    from pioneer_gazebo.world.sdf import world_from_sdf

    report.kind = "world"
    world = world_from_sdf(file, model_path())
    for model in world.models:
        prepare(model.links, model.static, lambda _: None)
    report.taken = f"{world.name}: {len(world.models)} models"
    for line in world.warnings:
        report.warn(line)


def _check_yaml(file: Path, report: Report, parameters: list[tuple[Report, Any]]) -> None:
    """Checks a YAML file; one with parameters of navigation is added to ``parameters`` instead."""
    import rosparam
    import yaml

    from nav_bundle.check_parameters import namespaces_of

    try:
        # The reader of <rosparam command="load">.
        content = {}
        for values, _ in rosparam.load_file(str(file)):
            content = values
    except (
        rosparam.RosParamException, yaml.YAMLError, ValueError, ArithmeticError, OSError,
    ) as error:  # fmt: skip
        mark = getattr(error, "problem_mark", None)
        report.refused.append(Note(" ".join(str(error).split()), mark.line + 1 if mark else None))
        return
    names = set(content) if isinstance(content, Mapping) else set()
    if {"image", "resolution"} <= names:
        _guarded(_check_map, file, report)
    elif "scenario" in names:
        _guarded(_check_study, file, report)
    elif names == {"robots"} and isinstance(content["robots"], list):
        _guarded(_check_fleet, file, report)
    elif "robots" in names or names & _SCENARIO:
        _guarded(_check_scenario, file, report)
    elif namespaces_of(content):
        report.kind = "parameters"
        parameters.append((report, content))
    else:
        report.refuse(
            "is neither a map (image, resolution), a fleet file (robots), a scenario nor a study, and has no parameter"
            " of move_base, amcl or slam_gmapping"
        )


def _check_map(file: Path, report: Report) -> None:
    from nav_bundle.base.error import MapError
    from nav_bundle.maps.map_file import read_map

    report.kind = "map"
    try:
        grid = read_map(file)
    except MapError as error:
        # The first of its words that is a field's name tells the line; most are in the text after the file's name.
        places = _places(file, report)
        words = re.findall(r"\w+", str(error).replace(str(file), ""))
        line = next((places[(word,)] for word in words if (word,) in places), None)
        report.refused.append(Note(str(error), line))
        return
    report.taken = f"{grid.cols} x {grid.rows} cells of {grid.resolution:g} m"


def _check_scenario(file: Path, report: Report) -> None:
    from pioneer_demo.scenario.scenario_file import read_scenario
    from pioneer_node.core.parameter import UNKNOWN

    report.kind = "scenario"
    with UNKNOWN.noted() as warnings:
        scenario = read_scenario(file)
    report.taken = f"{len(scenario.names)} robots in {scenario.world}"
    for text in warnings:
        report.warn(text)
    robots = () if isinstance(scenario.robots, int) else scenario.robots
    for name in dict.fromkeys((scenario.navigation, *(robot.navigation for robot in robots))):
        _check_named(name, report)
    for name in dict.fromkeys(robot.description for robot in robots):
        _check_named(name, report)


def _check_study(file: Path, report: Report) -> None:
    from pioneer_demo.study.study import Study
    from pioneer_node.adapters.document import read_document

    report.kind = "study"
    study = read_document(Study, file)
    report.taken = f"{len(study.variants)} variants of {study.scenario}, {study.runs} runs each"


def _check_fleet(file: Path, report: Report) -> None:
    from pioneer_node.adapters.fleet_file import read_fleet

    report.kind = "fleet file"
    robots = read_fleet(file)
    report.taken = f"{len(robots)} robots"
    for name in dict.fromkeys(
        name for robot in robots for name in (robot.description, robot.navigation)
    ):
        _check_named(name, report)


def _check_named(name: str, report: Report) -> None:
    """Adds to a report what is said of a file that its file names; an empty name and ``none`` have nothing."""
    from nav_bundle.check_parameters import shipped_parameters
    from pioneer_node.core.fleet_file import NO_NAVIGATION

    if name in ("", NO_NAVIGATION):
        return
    inner = Report(name)
    if name.endswith((".yaml", ".yml")):
        parameters: list[tuple[Report, Any]] = []
        _check_yaml(Path(name), inner, parameters)
        _check_parameters(parameters, shipped_parameters(), "move_base")
    else:
        _guarded(_check_xml, Path(name), inner)
    for notes, found in ((report.refused, inner.refused), (report.warnings, inner.warnings)):
        notes += [
            Note(f"{name}{f':{note.line}' if note.line else ''}: {note.text}") for note in found
        ]


def _check_parameters(
    files: Sequence[tuple[Report, Any]],
    others: Mapping[str, Any] | None = None,
    namespace: str = "",
) -> None:
    """Reads the parameters of files as those of one robot, and adds what is said of them to the files' reports.

    Args:
        files: reports and contents; of a name in several files, the last one counts.
        others: parameters that the robot has besides.
        namespace: into which all files are loaded; empty to find out for each.
    """
    from nav_bundle.check_parameters import flattened, namespaces_of, read_as_nodes_do

    if not files:
        return
    together = dict(others or {})
    lines: list[tuple[Report, Lines]] = []
    for report, content in files:
        namespaces = (namespace,) if namespace else namespaces_of(content)
        count = len(flattened("", content))
        report.taken = f"{count} for {' and '.join(name or 'the robot' for name in namespaces)}"
        places = _places(Path(report.file), report)
        for each in namespaces:
            together.update(flattened(each, content))
            head = tuple(each.split("/")) if each else ()
            lines.append((report, {(*head, *place): line for place, line in places.items()}))
    for found, field in zip(read_as_nodes_do(together), ("refused", "warnings"), strict=True):
        for text in found:
            report, line = _place_of(text, lines)
            note = Note(text, line)
            if note not in getattr(report, field):
                getattr(report, field).append(note)


def _place_of(text: str, lines: Sequence[tuple[Report, Lines]]) -> tuple[Report, int | None]:
    """Returns the report and line of the parameter that a message is about.

    Messages begin with the namespace and have the parameter's name after it, mostly with a ``~``. Without the
    parameter itself it is the closest namespace around it.
    """
    owner = re.match(r"[\w/]+", text)
    namespace = tuple(owner[0].strip("/").split("/")) if owner else ()
    names = re.findall(r"~([\w/]+)", text) or re.findall(
        r"\w+", text[owner.end() if owner else 0 :]
    )
    wanted = [(*namespace, *name.split("/")) for name in names]
    # A value may also be in a namespace around, such as a source's obstacle_range.
    for outer in range(len(namespace), 0, -1):
        wanted += [(*namespace[:outer], *name.split("/")) for name in names]
    wanted += [namespace[:length] for length in range(len(namespace), 0, -1)]
    for place in wanted:
        for report, known in reversed(lines):
            if place in known:
                return report, known[place]
    return lines[-1][0], None


def _places(file: Path, report: Report) -> Lines:
    """Returns the line of each parameter by its names; a name that is given twice is left out with a note."""
    import yaml

    found: Lines = {}

    def walk(node: Any, place: tuple[str, ...]) -> None:
        if not isinstance(node, yaml.MappingNode):
            return
        for key, value in node.value:
            own = (*place, *str(key.value).strip("/").split("/"))
            line = key.start_mark.line + 1
            if own in found:
                text = f"{'/'.join(own)} is given again on line {line}, which counts"
                report.warnings.append(Note(text, found[own]))
            found[own] = line
            walk(value, own)

    # Of several documents the last one counts, as for rosparam.
    for document in yaml.compose_all(file.read_text(), Loader=yaml.SafeLoader):
        found.clear()
        walk(document, ())
    return found


if __name__ == "__main__":
    sys.exit(main())
