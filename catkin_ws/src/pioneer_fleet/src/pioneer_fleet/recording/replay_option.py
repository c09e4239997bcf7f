"""Command line of ``./pioneer replay``."""

import argparse
from pathlib import Path


def parser() -> argparse.ArgumentParser:
    """Returns the argument parser."""
    made = argparse.ArgumentParser(
        "./pioneer replay",
        description="Publishes a recording's messages on a ROS master of its own, and prints its address.\n"
        "Topic names are those of the fleet; the topics of all recorded masters are on this one.",
        epilog="Example: ./pioneer replay run.mcap, and with the ROS_MASTER_URI that it prints:\n"
        "  ./pioneer run rviz -d $(rospack find pioneer_description)/rviz/multi_pioneer.rviz",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("file", type=Path, metavar="FILE", help="a recording, .mcap or .bag")
    made.add_argument(
        "--rate", type=float, default=1.0, metavar="R", help="recorded seconds a second (default 1)"
    )
    made.add_argument(
        "--start",
        type=float,
        default=0.0,
        metavar="S",
        help="begin S recorded seconds after the first message, with what was latched by then",
    )
    made.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    made.add_argument(
        "--topics",
        nargs="+",
        default=[],
        metavar="NAME",
        help="play only these, such as /clock '/tf*' '/aadi1/*'",
    )
    made.add_argument(
        "--simulated",
        action="store_true",
        help="--rate counts simulated seconds, as /clock has them, not those of the recording's wall clock",
    )
    made.add_argument(
        "--stay", action="store_true", help="keep the master, with its latched topics, until Ctrl-C"
    )
    made.add_argument(
        "--web",
        action="store_true",
        help="show it in the browser, with a slider (docs/web.md); keeps it",
    )
    made.add_argument(
        "--repair",
        type=Path,
        metavar="NEW",
        help="play nothing, but write what can be read of an incomplete or damaged FILE to NEW",
    )
    return made
