"""Demos in lockstep: the same bytes, whatever else the machine does."""

import json
import subprocess
import sys

from pioneer_harness.proc import processors

_WHOLE = 300.0
_SAME = ("ground_truth.csv", "commands.csv", "report.json")


def test_two_runs_in_lockstep_are_equal_byte_by_byte_one_beside_a_busy_machine(start):
    def run():
        demo = start("--lockstep", "--robots", 2, "--waypoints", 1, "--world", "small_world", "--seed", 4)
        assert demo.process.wait(_WHOLE) == 0, demo.text()
        return {name: (demo.report / name).read_bytes() for name in _SAME}

    alone = run()
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(round(processors()) or 1)]
    try:
        beside = run()
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
    assert [name for name in _SAME if alone[name] != beside[name]] == []
    assert alone["commands.csv"].count(b"\n") > 100
    assert json.loads(alone["report.json"])["success"]
