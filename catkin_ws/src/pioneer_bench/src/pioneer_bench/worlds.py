"""``pioneer_bench worlds``: what each world costs to load and to run with ten robots, and whether beams are true."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import rospkg

from pioneer_bench.adapters.description import pioneer_urdf

TEST_WORLDS = "test/world"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--output", type=Path, default=Path("bench-report"), metavar="DIR", help="default: %(default)s")
    parser.add_argument("--robots", type=int, default=10, metavar="N", help="in each world (default: %(default)s)")
    parser.add_argument(
        "--world", nargs="*", default=[], metavar="FILE", help="only these (default: all of the package)"
    )


def run(options: argparse.Namespace) -> int:
    """Runs each world in a process of its own; returns 0 where all goals hold, else 1."""
    package = Path(rospkg.RosPack().get_path("pioneer_gazebo"))
    files = [Path(name) for name in options.world]
    files = files or sorted([*(package / "worlds").glob("*.world"), *(package / TEST_WORLDS).glob("*.world")])
    urdf = pioneer_urdf(laser_noise=0)
    figures = []
    print("| world | robots | load [s] | RSS [MB] | factor | beams | true | largest error [mm] |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for file in [*files, *([] if options.world else map(Path, ("285 loose boxes", "97 mesh models")))]:
        command = [sys.executable, "-m", "pioneer_bench.nodes.world", str(file), str(options.robots)]
        done = subprocess.run(command, input=urdf, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"| {file.stem} | failed: {done.stderr.strip().splitlines()[-1]} | | | | | | |")
            figures.append({"world": file.stem, "holds": False})
            continue
        one = json.loads(done.stdout.splitlines()[-1])
        figures.append(one)
        print(
            f"| {one['world']} | {one['robots']} | {one['load']:.2f} | {one['rss']:.0f} | {one['factor']:.1f} |"
            f" {one['beams']} | {one['true']} | {one['worst'] * 1e3:.1f} |{'' if one['holds'] else ' !'}",
            flush=True,
        )
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "worlds.json").write_text(json.dumps(figures, indent=2) + "\n")
    return 0 if all(one["holds"] for one in figures) else 1
