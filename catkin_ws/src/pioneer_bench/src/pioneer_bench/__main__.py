"""The command ``./pioneer bench``."""

import argparse
import importlib
import signal
import sys
from pathlib import Path

BENCHES = {
    "sim": "the simulator: CPU, memory and scans by number of robots",
    "accuracy": "the simulator: motion, contacts and laser against what they should be",
    "worlds": "the simulator: each world with ten robots, and its beams against an independent caster",
    "gateway": "the gateway: how fast rules act, what relaying costs beside peers",
    "nav": "navigation: success, accuracy and cost of one robot's tours",
    "learning": "the learning environment: agent-steps a CPU-second, by number of robots",
    "lockstep": "fleets in lockstep: real-time factor, CPU, and equal results, by number of robots",
    "web": "the fleet page: CPU of its server and bytes to a page, by the number of pages",
    "ros2": "the door to ROS 2: cost and latency beside a bridge of rclpy and rospy objects",
    "compare": "two reports of one bench: ratios with the machine's speed taken out, and what is worse",
    "traffic": "right of way: fleets on random tours in narrow and shipped worlds, without ROS",
}
"""Modules of this package with a description of each bench."""


def main() -> int:
    """Runs the bench named on the command line; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="./pioneer bench",
        description="Measures, and prints the figures beside those to reach. ./pioneer bench BENCH --help has options.",
        epilog="example: ./pioneer bench sim --robots 1 5",
    )
    benches = parser.add_subparsers(required=True, metavar="BENCH")
    benches.add_parser(
        "containers", help="the fleet in containers: start-up, CPU, memory and traffic by its size"
    )
    for name, text in BENCHES.items():
        one = benches.add_parser(name, help=text)
        if name in sys.argv[1:2]:  # does not import what only the other benches need
            bench = importlib.import_module(f"pioneer_bench.{name}")
            bench.add_arguments(one)
            if name != "compare":
                one.add_argument("--output", type=Path, default=Path("bench-report"), metavar="DIR",
                    help="where the figures go (default: %(default)s)")  # fmt: skip
            one.set_defaults(run=bench.run, measures=name != "compare")
    options = parser.parse_args()
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.default_int_handler)
    try:
        if options.measures:
            from pioneer_bench import report

            report.begin()
        return options.run(options)
    except KeyboardInterrupt:
        print("\ninterrupted")
        return 130


if __name__ == "__main__":
    sys.exit(main())
