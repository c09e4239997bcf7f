"""Stands in for run-scenario in the tests of experiments: its figures depend only on variant and seed."""

import argparse
import json
import os
import pathlib
import time

import yaml

parser = argparse.ArgumentParser()
parser.add_argument("scenario", type=pathlib.Path)
parser.add_argument("--seed", type=int)
parser.add_argument("--report", type=pathlib.Path)
options = parser.parse_args()
scenario = yaml.safe_load(options.scenario.read_text())
slow, journal = scenario["waypoints"], pathlib.Path(scenario["about"])


def note(word: str) -> None:
    with journal.open("a") as file:
        file.write(f"{word} {slow} {options.seed} {os.getppid()}\n")


note("begin")
time.sleep(1.0)  # simulates the work of a run: long enough to be killed halfway
note("end")
robot = {"seconds": 10.0 * slow + options.seed, "path_length": 5.0, "collisions": 0}
report = {"success": options.seed != 2, "faults": [], "robots": {"pioneer1": robot}, "drive": {}}
(options.report / "report.json").write_text(json.dumps(report))
