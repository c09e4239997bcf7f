"""``fleet_description FILE``: prints a robot's description with the fleet's topics and frames, or its footprint."""
# ruff: noqa: T201 - a command prints to standard output

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.fleet.fleet_description import SCAN, expanded, fleet_description


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the description to standard output and each change to standard error; returns the exit status."""
    options = _parser().parse_args(argv)
    path = Path(options.file)
    try:
        described = fleet_description(expanded(path), options.laser)
        if options.footprint:
            # Loading scipy takes long.
            from pioneer_gazebo.fleet.footprint import footprint

            print(json.dumps(footprint(described.text)))
            return 0
    except DescriptionError as error:
        print(f"fleet_description: {error}", file=sys.stderr)
        return 1
    for change in described.changes:
        print(f"{path.name}: {change}", file=sys.stderr)
    print(described.text)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "fleet_description",
        description="Prints a robot's description with the topics and frames by which a fleet knows its robots.",
    )
    parser.add_argument("file", help="URDF or xacro file")
    parser.add_argument(
        "--laser",
        default=SCAN,
        metavar="TOPIC",
        help="topic of the laser that navigation uses (default %(default)s)",
    )
    parser.add_argument(
        "--footprint",
        action="store_true",
        help="print the corners of its outline on the floor instead: JSON, [[x, y], …] about base_link [m]",
    )
    return parser
