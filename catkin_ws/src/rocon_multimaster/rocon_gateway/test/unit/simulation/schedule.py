"""Fault schedules: drawn from a seed, and shrunk while they still fail."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

NAMES = ("base", "aadi1", "aadi2")
FAULTS = (
    "crash",
    "stop",
    "hub crash",
    "hub freeze",
    "cut from hub",
    "cut link",
    "impostor",
    "node",
    "node",
    "rule",
    "rule",
)
SPAN = 8.0
"""Within which faults begin [s]."""


@dataclass(frozen=True, order=True)
class Fault:
    """A fault: when it begins [s], whom it affects and how long it lasts [s]; `choice` selects one of several."""

    at: float
    kind: str
    gateway: str
    other: str
    seconds: float
    choice: int


def drawn(seed: int) -> list[Fault]:
    """Returns a schedule of one to five faults, ordered by time."""
    source = random.Random(seed)
    faults = []
    for _ in range(source.randint(1, 5)):
        gateway, other = source.sample(NAMES, 2)
        seconds = source.choice((0.05, 0.5, 1.9, 2.3, 4.0, 9.0))
        faults.append(
            Fault(
                source.uniform(0, SPAN),
                source.choice(FAULTS),
                gateway,
                other,
                seconds,
                source.randrange(1000),
            )
        )
    return sorted(faults)


def shrunk(faults: Sequence[Fault], fails: Callable[[Sequence[Fault]], bool]) -> list[Fault]:
    """Returns a reduced schedule that still fails and from which no fault can be removed."""
    faults = list(faults)
    for fault in list(faults):
        fewer = [one for one in faults if one is not fault]
        if fails(fewer):
            faults = fewer
    return faults
