"""``pioneer_bench gateway``: how fast rules take effect, and the cost of relaying beside a direct connection."""

import argparse
import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path

from pioneer_bench.adapters.crowd_trial import crowd_rows, password_rows
from pioneer_bench.adapters.fleet import Fleet
from pioneer_bench.adapters.flow_trial import flow_rows, idle_rows, service_rows, tls_rows
from pioneer_bench.adapters.rule_trial import call_rows, cut_rows, fault_rows, publisher_rows
from pioneer_bench.core.row import Row
from pioneer_bench.report import finish
from pioneer_harness.error import HarnessError
from pioneer_launch.door import patch_master
from tcpros.client import ClientError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--quick", action="store_true", help="one repetition, short windows")
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="TRIAL", help="some of the trials, by their names"
    )
    parser.add_argument(
        "--repetitions", type=int, default=3, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seconds", type=float, default=2.0, help="length of each window [s]")


def run(options: argparse.Namespace) -> int:
    """Runs all trials; returns 0 if every goal is met, 1 if one is missed, 2 if a trial failed."""
    repetitions, seconds = (1, 1.0) if options.quick else (options.repetitions, options.seconds)
    rows: list[Row] = []
    failure = ""
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="pioneer-bench-"))
        # rosmaster runs in this process and prints a traceback for each node that was killed.
        stack.enter_context(
            contextlib.redirect_stderr(stack.enter_context(open(Path(folder) / "masters.log", "w")))
        )
        patch_master()  # as in masters that our launcher starts
        fleet = Fleet(Path(folder))
        trials: dict[str, Callable[[], list[Row]]] = {
            "rules": lambda: call_rows(fleet, 2 * repetitions),
            "new publishers": lambda: publisher_rows(fleet, repetitions),
            "idling": lambda: idle_rows(fleet, 4 * seconds),
            "services": lambda: service_rows(fleet, repetitions),
            "messages": lambda: flow_rows(fleet, repetitions, seconds),
            "TLS": lambda: tls_rows(Path(folder), repetitions, seconds),
            "faults": lambda: fault_rows(fleet, repetitions),
            "a machine that is gone": lambda: cut_rows(fleet, Path(folder), repetitions),
            "a thousand gateways": lambda: crowd_rows(fleet),
            "a password": lambda: password_rows(Path(folder)),
        }
        if unknown := set(options.only) - set(trials):
            print(f"no trial {', '.join(sorted(unknown))}; there are {', '.join(trials)}")
            return 2
        trials = {
            what: trial
            for what, trial in trials.items()
            if what in options.only or not options.only
        }
        stack.callback(fleet.close)
        try:
            fleet.start()
            for what, trial in trials.items():
                print(f"{what} …", flush=True)
                rows += trial()
        except (HarnessError, ClientError, OSError) as error:
            failure = str(error)
    status = finish(options, "gateway", "The gateway", rows)
    if failure:
        print(f"the bench failed: {failure}")
    return 2 if failure else status
