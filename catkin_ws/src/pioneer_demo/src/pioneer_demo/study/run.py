"""Executes one run of a study on a worker, in its own process and folder."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pioneer_demo.error import DemoError
from pioneer_demo.study.study import Run, row_of
from pioneer_harness.process import last_lines

# A killed worker must not leave a fleet running.
_PREFIX = ("/usr/bin/setpriv", "--pdeathsig", "TERM", "--")
OWN_PROGRAM = (sys.executable, "-m", "pioneer_demo", "run-scenario")


class RunError(DemoError):
    """A run was interrupted or wrote no report; it counts as not done."""


def run_scenario(
    program: Sequence[str], scenario: str, run: Run, keep: str, scratch: str
) -> dict[str, Any]:
    """Runs a program on a scenario; returns the row of its metrics.

    Args:
        program: command line, to which ``FILE --seed S --report DIR`` is appended.
        scenario: the scenario file's content.
        run: the run of the study.
        keep: folder for its output; empty for a temporary one.
        scratch: where to make the temporary folder; empty for the machine's usual place.

    Raises:
        RunError: the program was ended by a signal or wrote no report.
    """
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="pioneer-study-", dir=scratch or None) as temporary:
        folder = Path(keep) if keep else Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scenario.yaml").write_text(scenario)
        words = [str(folder / "scenario.yaml"), "--seed", str(run.seed), "--report", str(folder)]
        log, report, machine = (
            folder / name for name in ("output.txt", "report.json", "machine.json")
        )
        for stale in (report, machine):
            stale.unlink(missing_ok=True)
        with log.open("wb") as output:
            status = subprocess.run(
                [*_PREFIX, *(program or OWN_PROGRAM), *words], check=False, env=os.environ, stdin=subprocess.DEVNULL,
                stdout=output, stderr=subprocess.STDOUT,
            ).returncode  # fmt: skip
        if status < 0 or status > 128:
            raise RunError(f"{run.name} was interrupted")
        if not report.is_file():
            raise RunError(f"no report, exit status {status}:\n{last_lines(log)}")
        content = json.loads(report.read_text())
        if machine.is_file():  # in lockstep the run's cost is in a separate file
            content["drive"] = json.loads(machine.read_text())["drive"] | content["drive"]
    return row_of(run, content, time.monotonic() - began)
