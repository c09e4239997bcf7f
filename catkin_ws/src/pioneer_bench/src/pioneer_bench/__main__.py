"""The command ``./pioneer bench``."""

import argparse
import sys

from pioneer_bench import accuracy, gateway, nav, sim


def main() -> int:
    """Runs the bench that the command line names; returns its exit status."""
    parser = argparse.ArgumentParser(prog="pioneer bench", description="Measurements beside the figures to reach.")
    benches = parser.add_subparsers(required=True, metavar="BENCH")
    one = benches.add_parser("sim", help="the simulator: CPU, memory and scans by number of robots")
    sim.add_arguments(one)
    one.set_defaults(run=sim.run)
    one = benches.add_parser("accuracy", help="the simulator: motion, contacts and laser against what they should be")
    accuracy.add_arguments(one)
    one.set_defaults(run=accuracy.run)
    one = benches.add_parser("gateway", help="the gateway: how fast rules act, what relaying costs beside peers")
    gateway.add_arguments(one)
    one.set_defaults(run=gateway.run)
    one = benches.add_parser("nav", help="navigation: success, accuracy and cost of one robot's tours")
    nav.add_arguments(one)
    one.set_defaults(run=nav.run)
    options = parser.parse_args()
    return options.run(options)


if __name__ == "__main__":
    sys.exit(main())
