"""The command `rocon_launch`."""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import roslaunch.substitution_args
import roslib.packages
import rospkg
from rosgraph.names import load_mappings

from rocon_launch.concert import launches_from_text
from rocon_launch.concert_runner import ConcertRunner
from rocon_launch.error import ConcertError

USAGE = "rocon_launch [package] file.concert [arg:=value ...]"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a concert; returns the process's exit status."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = _parser().parse_args([one for one in arguments if ":=" not in one])
    try:
        path = _concert(options.name)
        launches = launches_from_text(
            path.read_text(), load_mappings(list(arguments)), _default_port(), _substituted
        )
        for launch in launches:
            _check(launch.package, launch.name)
    except ConcertError as error:
        sys.stderr.write(f"rocon_launch: {error}\n")
        return 1
    except OSError as error:
        sys.stderr.write(f"rocon_launch: {error}\n")
        return 1
    return ConcertRunner(launches, options.screen, _roslaunch()).run()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("rocon_launch", usage=USAGE + " [options]")
    parser.add_argument("name", nargs="+", help="package and file, or the path of a file")
    parser.add_argument("--screen", action="store_true", help="show the output of all nodes")
    parser.add_argument(
        "--no-terminals",
        action="store_true",
        help="run all in this terminal, which is done in any case",
    )
    return parser


def _concert(names: Sequence[str]) -> Path:
    if len(names) == 1:
        path = Path(names[0])
        if not path.is_file():
            raise ConcertError(f"there is no file {path}; usage: {USAGE}")
        return path
    if len(names) > 2:
        raise ConcertError(f"too many names; usage: {USAGE}")
    return _in_package(*names)


def _in_package(package: str, name: str) -> Path:
    try:
        root = Path(rospkg.RosPack().get_path(package))
    except rospkg.ResourceNotFound:
        raise ConcertError(f"there is no package '{package}'") from None
    found = sorted(path for path in root.rglob(name) if path.is_file())
    if not found:
        raise ConcertError(f"package '{package}' has no file '{name}'")
    return found[0]


def _roslaunch() -> str:
    """Returns this package's roslaunch, which forks Python nodes, or that of ROS if the workspace is not built."""
    try:
        return next(iter(roslib.packages.find_node("rocon_launch", "roslaunch")), "roslaunch")
    except rospkg.ResourceNotFound:
        return "roslaunch"


def _check(package: str, name: str) -> None:
    """Raises ConcertError if a launch file does not exist, before any roslaunch is started."""
    if package:
        _in_package(package, name)
    elif not Path(name).is_file():
        raise ConcertError(f"there is no launch file {name}")


def _default_port() -> int:
    port = os.environ.get("ROS_MASTER_URI", "").rstrip("/").rpartition(":")[2]
    return int(port) if port.isdigit() else 11311


def _substituted(text: str, arguments: Mapping[str, str]) -> str:
    try:
        return roslaunch.substitution_args.resolve_args(text, {"arg": dict(arguments)})
    except roslaunch.substitution_args.SubstitutionException as error:
        raise ConcertError(f"'{text}': {error}") from None
    except rospkg.ResourceNotFound as error:
        raise ConcertError(f"'{text}': there is no package {error}") from None
