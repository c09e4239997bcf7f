"""``plan_to_world``: creates worlds from floor plans drawn with characters."""
# ruff: noqa: T201 - a command prints to standard output

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pioneer_gazebo.commands.floor_plan import plan_from_text, world_of_plan
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.sdf import GROUND_PLANE
from pioneer_gazebo.world.sdf_text import sdf_from_world


def world_text(plan: Path) -> str:
    """Returns the SDF text of the world drawn in the file ``plan``, named after the file.

    Raises:
        DescriptionError: the file cannot be read or is not a plan.
    """
    try:
        text = plan.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise DescriptionError(f"{plan}: cannot be read: {error}") from None
    return sdf_from_world(world_of_plan(plan_from_text(text, str(plan)), plan.stem, GROUND_PLANE))


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line and writes the worlds; returns the exit status."""
    parser = argparse.ArgumentParser(
        "plan_to_world", description="Turns drawn floor plans into Gazebo worlds."
    )
    parser.add_argument(
        "plan", nargs="+", type=Path, help="file with the drawing; worlds/plan/ has examples"
    )
    parser.add_argument(
        "-d",
        "--directory",
        type=Path,
        help="where NAME.world goes (default: above the plan's directory)",
    )
    options = parser.parse_args(sys.argv[1:] if argv is None else argv)
    for plan in options.plan:
        try:
            text = world_text(plan)
        except DescriptionError as error:
            print(f"plan_to_world: {error}", file=sys.stderr)
            return 1
        target = (options.directory or plan.resolve().parent.parent) / f"{plan.stem}.world"
        target.write_text(text)
        print(target)
    return 0
