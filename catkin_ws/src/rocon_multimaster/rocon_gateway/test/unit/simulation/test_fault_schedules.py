"""Thousands of random fault schedules against the real compare function, hub client and hub registry."""

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import pytest
from schedule import Fault, drawn, shrunk
from world import World

SCHEDULES = int(os.environ.get("PIONEER_SCHEDULES", "10000"))
FIRST = int(os.environ.get("PIONEER_SCHEDULES_FIRST", "0"))
CHUNK = 250


def test_a_fleet_converges_after_any_faults() -> None:
    starts = range(FIRST, FIRST + SCHEDULES, CHUNK)
    with ProcessPoolExecutor() as pool:
        reports = [report for reports in pool.map(_reports, starts) for report in reports]
    if reports:
        pytest.fail(f"{len(reports)} of {SCHEDULES} schedules failed\n" + "\n".join(reports[:5]))


def test_a_failing_schedule_shrinks_to_the_fault_that_fails() -> None:
    faults = drawn(4)
    assert len(faults) > 1
    assert shrunk(faults, lambda some: faults[-1] in some) == [faults[-1]]


def _reports(start: int) -> list[str]:
    """Returns the failures among `CHUNK` schedules, each with a minimal set of faults that causes it."""
    found = []
    for seed in range(start, min(start + CHUNK, FIRST + SCHEDULES)):
        if wrong(seed, drawn(seed)):
            faults = shrunk(drawn(seed), partial(wrong, seed))
            found.append(f"seed {seed}: {wrong(seed, faults)}\n  " + "\n  ".join(map(str, faults)))
    return found


def wrong(seed: int, faults: Sequence[Fault]) -> str:
    """Returns what is wrong at the end of a schedule, or "" if nothing is."""
    return World(seed, faults).run()
