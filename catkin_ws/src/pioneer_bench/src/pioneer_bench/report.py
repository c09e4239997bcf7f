"""Shared by all benches: writing results, and measuring in a separate process."""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pioneer_bench import speed
from pioneer_bench.core.row import Row, table

LOAD = os.getloadavg()[0]
"""Load average of this machine before the run."""


_speed_before: list[speed.Speed] = []
"""The machine's speed before the bench; empty until ``begin``."""


def begin() -> None:
    """Measures the machine's speed, before a bench."""
    _speed_before[:] = [speed.measured()]


def write(folder: Path, name: str, title: str, text: str, values: object) -> None:
    """Prints ``text``, writes it to ``name``.md in ``folder``, and writes ``values`` to ``name``.json.

    If ``begin`` was called, the JSON has the machine's speed before and after the bench, for ``bench compare``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.md").write_text(f"# {title}\n\n{text}\n")
    if _speed_before and isinstance(values, dict):
        machine = {"before": _speed_before[0].as_dict(), "after": speed.measured().as_dict()}
        values = {"machine": machine, **values}
    (folder / f"{name}.json").write_text(json.dumps(values, indent=2) + "\n")
    print(f"\n{text}\n\nwritten: {folder / name}.md and .json")


def finish(
    options: argparse.Namespace,
    name: str,
    title: str,
    rows: Sequence[Row],
    remark: str = "",
    **values: Any,
) -> int:
    """Writes the table of ``rows`` with a remark, and the same with ``values`` as JSON.

    Returns:
        The bench's exit status: 0 if every goal is met, else 1.
    """
    conditions = f"{os.cpu_count()} cores, load before the run {LOAD:.1f}; medians and ranges."
    text = f"{table(rows)}\n\n{conditions} {remark}".strip()
    found = {
        "cores": os.cpu_count(),
        "load": LOAD,
        "rows": [row.as_dict() for row in rows],
        **values,
    }
    write(options.output, name, title, text, found)
    return 1 if any(row.holds is False for row in rows) else 0


def measured(node: str, setting: dict[str, Any], hear: Callable[[str], object] = print) -> Any:
    """Runs ``pioneer_bench.nodes.NODE`` as a process; returns its last line, parsed as JSON, or None if it failed.

    A process can be only one ROS node on one master, and the bench's own memory and CPU time must not count.

    Args:
        node: name of the module; its only argument is ``setting`` as JSON.
        setting: what to measure.
        hear: called with every other line.
    """
    command = [sys.executable, "-m", f"pioneer_bench.nodes.{node}", json.dumps(setting)]
    result = None
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("{"):
                result = json.loads(line)
            else:
                hear(line.rstrip())
    return result if process.returncode == 0 else None
