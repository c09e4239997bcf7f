"""Kills, and stops for 20 s, each process of a native fleet in turn; prints the tables of ``docs/failures.md``.

Takes half an hour: ``./pioneer test --soak`` runs it. ``PIONEER_FAILURES`` restricts it to processes whose name in the
tables matches this regular expression.
"""

import os
import re
import signal
import sys
import time
from collections.abc import Callable
from functools import partial

import pytest
from real_fleet import Fleet

from pioneer_harness.wait import WaitError, wait_until

pytestmark = pytest.mark.soak

SETTLED = 60.0
"""Time limit for a fleet to be as before after a death [s]; one whose process is not started again waits for it."""
STOPPED = 20.0
CONTINUED = 30.0
"""Time limit for a process that was stopped to answer again [s]."""
LEFT = 60.0
"""Time limit for the end of a fleet's processes, once its command has ended [s]."""


def chosen(fleet: Fleet) -> list[str]:
    """Returns the names of the processes to try."""
    words = os.environ.get("PIONEER_FAILURES", "")
    return [label for label in sorted(fleet.all) if re.search(words, label)]


def settles(condition: Callable[[], bool], timeout: float) -> bool:
    """Waits until a condition holds; returns whether it did in time."""
    try:
        return bool(wait_until(condition, "the fleet's recovery", timeout))
    except WaitError:
        return False


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def row(*cells: str) -> str:
    text = " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells)
    return f"| {re.sub(r'pid [0-9]+', 'pid N', text)} |"


def short(lines: list[str], most: int = 3) -> str:
    """Returns the first lines as one cell, without the folders of this run."""
    return "<br>".join(f"`{line[:220]}`" for line in lines[:most]) or "nothing"


def test_the_death_of_each_process_is_said_and_mended_or_ends_the_fleet(start, tmp_path):
    fleet = Fleet(start, tmp_path, 0)
    todo = chosen(fleet)
    silent = []
    say(
        "\n| process | what is said | after [s] | what is started again | what ends |\n|---|---|---|---|---|"
    )
    for number, label in enumerate(todo, 1):
        before, position = fleet.labels(), fleet.position
        os.kill(before[label], signal.SIGKILL)
        began = time.monotonic()
        settles(partial(fleet.is_restored, label, before[label]), SETTLED)
        after = time.monotonic() - began
        if fleet.has_ended:
            began = time.monotonic()
            wait_until(fleet.is_gone, "the end of all its processes", LEFT)
        now = fleet.labels()
        said = fleet.said_since(position)
        again = [name for name, pid in sorted(now.items()) if before.get(name) != pid]
        gone = "the fleet" if fleet.has_ended else ", ".join(sorted(set(before) - set(now)))
        say(row(label, short(said), f"{after:.0f}", ", ".join(again) or "-", gone or "nothing"))
        if not said and not (again or "Redis" in label):
            silent.append(label)
        # A computer that is started three times in a minute keeps dying: the next trial gets a fresh fleet.
        if fleet.has_ended or set(now) != fleet.all or len(again) > 1:
            fleet.running.end()
            if number < len(todo):
                fleet = Fleet(start, tmp_path, number)
    assert not silent, f"nothing is said of the death of {silent}"


def test_a_process_that_hangs_is_named_and_continues(start, tmp_path):
    fleet = Fleet(start, tmp_path, 0)
    todo = chosen(fleet)
    say(
        "\n| process | what is said | after [s] | once it continues | what ends |\n|---|---|---|---|---|"
    )
    for number, label in enumerate(todo, 1):
        before, position = fleet.labels(), fleet.position
        os.kill(before[label], signal.SIGSTOP)
        began = time.monotonic()
        first = None
        while time.monotonic() - began < STOPPED and not fleet.has_ended:
            if first is None and fleet.said_since(position):
                first = time.monotonic() - began
            time.sleep(0.1)
        said = fleet.said_since(position)
        continued = fleet.position
        if fleet.named(label) == before[label]:
            os.kill(before[label], signal.SIGCONT)
        settles(partial(fleet.has_continued, bool(said), continued), CONTINUED)
        now = fleet.labels()
        gone = "the fleet" if fleet.has_ended else ", ".join(sorted(set(before) - set(now)))
        when = "-" if first is None else f"{first:.1f}"
        answered = short(fleet.said_since(continued))
        say(row(label, short(said), when, answered, gone or "nothing"))
        if fleet.has_ended or set(now) != fleet.all:
            fleet.running.end()
            if number < len(todo):
                fleet = Fleet(start, tmp_path, number)
