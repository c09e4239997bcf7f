"""``pioneer_bench worlds``: cost of loading each world and running it with ten robots, and accuracy of its scans."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rospkg

from pioneer_bench.core.row import markdown
from pioneer_bench.report import measured, write

HEADINGS = (
    "world",
    "robots",
    "load [s]",
    "RSS [MB]",
    "factor",
    "beams",
    "true",
    "largest error [mm]",
    "holds",
)
FORMS = "{world}|{robots}|{load:.2f}|{rss:.0f}|{factor:.1f}|{beams}|{true}|{millimetres:.1f}|{word}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument(
        "--robots", type=int, default=10, metavar="N", help="in each world (default: %(default)s)"
    )
    parser.add_argument(
        "--world",
        nargs="*",
        default=[],
        metavar="FILE",
        help="only these (default: all of the package)",
    )


def run(options: argparse.Namespace) -> int:
    """Runs each world in a separate process; returns 0 if all goals are met, else 1."""
    package = Path(rospkg.RosPack().get_path("pioneer_gazebo"))
    shipped = sorted(
        [*(package / "worlds").glob("*.world"), *(package / "test" / "world").glob("*.world")]
    )
    figures = []
    for name in options.world or [*map(str, shipped), "285 loose boxes", "97 mesh models"]:
        one = measured("world", {"world": name, "robots": options.robots})
        one = one or {"world": Path(name).stem, "holds": False}
        print(" | ".join(_cells(one)), flush=True)
        figures.append(one)
    write(options.output, "worlds", "Worlds", markdown([HEADINGS, *map(_cells, figures)]), figures)
    return 0 if all(one["holds"] for one in figures) else 1


def _cells(one: Mapping[str, Any]) -> list[str]:
    if "robots" not in one:
        return [one["world"], *["-"] * (len(HEADINGS) - 2), "failed"]
    word = "yes" if one["holds"] else "no"
    return FORMS.format(**one, millimetres=one["worst"] * 1e3, word=word).split("|")
