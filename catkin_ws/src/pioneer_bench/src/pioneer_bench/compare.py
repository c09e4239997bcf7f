"""``pioneer_bench compare``: two reports of one bench, with the machine's speed taken out."""

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from pioneer_bench.core.comparison import ReportError, changes, machine_of, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this command's arguments."""
    parser.add_argument("old", type=Path, metavar="OLD.json", help="an earlier report of a bench")
    parser.add_argument(
        "new", type=Path, metavar="NEW.json", help="a later report of the same bench"
    )


def run(options: argparse.Namespace) -> int:
    """Prints the ratios; returns 0 if nothing is worse by more than the noise, 1 if something is, 2 for bad input."""
    names = (str(options.old), str(options.new))
    try:
        old = _report(options.old)
        new = _report(options.new)
        found = changes(old, new, names)
        speeds = [machine_of(old, names[0]), machine_of(new, names[1])]
    except ReportError as error:
        print(f"compare: {error}", file=sys.stderr)
        return 2
    print(table(found))
    for part in ("python", "kernel", "socket"):
        times = [1e3 * speed.time(part) for speed in speeds]
        print(
            f"machine, {part}: {times[0]:.2f} ms, then {times[1]:.2f} ms; taken out of the ratios"
        )
    judged = Counter(change.judgement for change in found)
    print(
        f"{len(found)} figures: {judged['worse']} worse, {judged['better']} better, {judged['changed']} changed"
    )
    return 1 if judged["worse"] else 0


def _report(path: Path) -> dict[str, Any]:
    """Returns the report in a file.

    Raises:
        ReportError: the file is no report of a bench.
    """
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise ReportError(f"cannot read {path}: {error.strerror}") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ReportError(f"{path} is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise ReportError(f"{path} is not the report of a bench that can be compared")
    return content
