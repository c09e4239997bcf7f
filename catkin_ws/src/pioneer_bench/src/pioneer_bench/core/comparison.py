"""Two reports of one bench: the ratio of each figure, with the machine's speed taken out, and what is really worse."""

import enum
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pioneer_bench.core.row import markdown

LEAST_NOISE = 0.03
"""Changes below this share are never more than noise: so far two runs of one commit differ on a quiet machine."""
_MACHINE = ("python", "kernel", "socket")
HEADINGS = ("figure", "unit", "old", "new", "ratio", "noise", "judgement")


class ReportError(Exception):
    """A report that cannot be compared; the message says why and what to do."""


class Better(enum.Enum):
    """Which way a figure should go."""

    LOWER = "lower"
    HIGHER = "higher"
    UNKNOWN = "unknown"


class Scale(enum.Enum):
    """How a figure depends on the machine's speed."""

    NONE = "none"  #: metres, megabytes, counts, simulated seconds
    CPU_TIME = "CPU time"
    LATENCY = "latency"
    CPU_RATE = "rate per CPU time"
    RATE = "rate"


_UNITS = {
    "CPU-s/sim-s": (Scale.CPU_TIME, Better.LOWER),
    "CPU-s/s": (Scale.CPU_TIME, Better.LOWER),
    "CPU-s": (Scale.CPU_TIME, Better.LOWER),
    "CPU ms": (Scale.CPU_TIME, Better.LOWER),
    "CPU µs": (Scale.CPU_TIME, Better.LOWER),
    "% of a core": (Scale.CPU_TIME, Better.LOWER),
    "ms": (Scale.LATENCY, Better.LOWER),
    "1/s": (Scale.CPU_RATE, Better.HIGHER),
    "msg/s": (Scale.RATE, Better.HIGHER),
    "MB/s": (Scale.RATE, Better.HIGHER),
    "MB": (Scale.NONE, Better.LOWER),
    "byte/s": (Scale.NONE, Better.LOWER),
}


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured quantity of a report."""

    samples: tuple[float, ...]
    unit: str
    better: Better
    scale: Scale

    @property
    def median(self) -> float:
        """The median of the samples."""
        return statistics.median(self.samples)

    @property
    def spread(self) -> float:
        """Half the range of the samples, as a share of the median; 0 for one sample."""
        if not self.median:
            return 0.0
        return (max(self.samples) - min(self.samples)) / abs(self.median) / 2.0


@dataclass(frozen=True, slots=True)
class Machine:
    """The machine's speed around one report."""

    before: Mapping[str, float]
    after: Mapping[str, float]

    def time(self, name: str) -> float:
        """Returns the geometric mean of a fixed piece of work's times before and after."""
        return math.sqrt(self.before[name] * self.after[name])

    @property
    def drift(self) -> float:
        """The greatest change of a time during the run, as a share."""
        return max(abs(math.log(self.after[name] / self.before[name])) for name in _MACHINE)


@dataclass(frozen=True, slots=True)
class Change:
    """One figure in both reports."""

    name: str
    old: Figure
    new: Figure
    slower: float  #: how much longer the machine took for the same work in the new report
    drift: float  #: of the machine's speed during either run, as a share

    @property
    def ratio(self) -> float:
        """New over old, as on the machine of the old report."""
        if not self.old.median:
            return math.inf if self.new.median else 1.0
        return self.new.median / self.old.median / self.slower

    @property
    def noise(self) -> float:
        """The share by which the ratio may differ from 1 without a reason."""
        drift = 0.0 if self.old.scale is Scale.NONE else self.drift
        return max(LEAST_NOISE, self.old.spread, self.new.spread, drift)

    @property
    def judgement(self) -> str:
        """``worse``, ``better``, ``changed`` (a figure without a known direction), or empty: within the noise."""
        if 1.0 / (1.0 + self.noise) <= self.ratio <= 1.0 + self.noise:
            return ""
        if self.old.better is Better.UNKNOWN:
            return "changed"
        is_better = (self.ratio < 1.0) == (self.old.better is Better.LOWER)
        return "better" if is_better else "worse"


def machine_of(report: Any, name: str) -> Machine:
    """Returns the machine's speed in a report.

    Raises:
        ReportError: the report is older than these measurements, or no report.
    """
    try:
        found = report["machine"]
        machine = Machine(found["before"], found["after"])
        for part in _MACHINE:
            if not machine.time(part) > 0.0:
                raise ValueError(part)
    except (KeyError, TypeError, ValueError):
        raise ReportError(
            f"{name} does not carry the machine's speed: run the bench again with this version"
        ) from None
    return machine


def figures_of(report: Mapping[str, Any]) -> dict[str, Figure]:
    """Returns the figures of a report by name: its rows, and the runs of the simulator's settings."""
    found = {}
    for row in report.get("rows", ()):
        samples = tuple(row.get("samples", ()))
        if samples:
            found[row["what"]] = _figure(
                samples, row["unit"], row.get("goal"), row.get("at_least", False)
            )
    for setting, runs in report.items():
        if not isinstance(runs, list) or setting == "rows":
            continue
        for run in runs:
            name = f"{setting}, {run['robots']} robots"
            found[f"{name}: cost"] = _figure((run["cost"],), "CPU-s/sim-s", None, at_least=False)
            found[f"{name}: first step"] = _figure(
                (run["first_step"],), "CPU-s", None, at_least=False
            )
            found[f"{name}: memory"] = _figure((run["rss"],), "MB", None, at_least=False)
    return found


def _figure(samples: tuple[float, ...], unit: str, goal: float | None, at_least: bool) -> Figure:
    scale, better = _UNITS.get(unit, (Scale.NONE, Better.UNKNOWN))
    if unit.endswith("/CPU-s"):
        scale, better = Scale.CPU_RATE, Better.HIGHER
    if goal is not None:
        better = Better.HIGHER if at_least else Better.LOWER
    return Figure(samples, unit, better, scale)


def changes(
    old: Mapping[str, Any], new: Mapping[str, Any], names: Sequence[str] = ("OLD", "NEW")
) -> list[Change]:
    """Returns the figures that both reports have, in the new one's order.

    Raises:
        ReportError: a report lacks the machine's speed, or they have no figure in common.
    """
    machines = machine_of(old, names[0]), machine_of(new, names[1])
    slower = {name: machines[1].time(name) / machines[0].time(name) for name in _MACHINE}
    drift = max(machine.drift for machine in machines)
    before = figures_of(old)
    found = [
        Change(name, before[name], figure, _slower(figure.scale, slower), drift)
        for name, figure in figures_of(new).items()
        if name in before and before[name].unit == figure.unit
    ]
    if not found:
        raise ReportError(
            f"{names[0]} and {names[1]} have no figure in common: are they of one bench?"
        )
    return found


def _slower(scale: Scale, slower: Mapping[str, float]) -> float:
    """Returns the factor by which a figure grows because the machine has become slower."""
    work = math.sqrt(slower["python"] * slower["kernel"])
    factors = {
        Scale.NONE: 1.0,
        Scale.CPU_TIME: work,
        Scale.CPU_RATE: 1.0 / work,
        Scale.LATENCY: slower["socket"],
        Scale.RATE: 1.0 / slower["socket"],
    }
    return factors[scale]


def table(found: Sequence[Change]) -> str:
    """Returns the changes as a Markdown table."""
    return markdown([HEADINGS, *(_cells(change) for change in found)])


def _cells(change: Change) -> tuple[str, ...]:
    return (
        change.name,
        change.old.unit,
        f"{change.old.median:.4g}",
        f"{change.new.median:.4g}",
        f"{change.ratio:.3f}",
        f"± {100.0 * change.noise:.0f} %",
        change.judgement,
    )
