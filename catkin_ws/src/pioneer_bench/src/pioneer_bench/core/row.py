"""Results of a bench: rows of samples beside their goals, and their table."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Row:
    """One measured quantity with its samples and goal."""

    what: str  #: name of the quantity
    unit: str  #: of samples and goal
    samples: tuple[float, ...]  #: one per repetition; none if it could not be measured
    goal: float | None = None  #: bound for the median; None for a row that is only for comparison
    at_least: bool = False  #: whether the goal is a lower bound
    remark: str = ""  #: source of the goal, or what went wrong
    every: bool = False  #: whether every sample must meet the goal, not only the median

    @property
    def median(self) -> float | None:
        """The median of the samples."""
        return statistics.median(self.samples) if self.samples else None

    @property
    def holds(self) -> bool | None:
        """Whether the goal is met; None without a goal. A sample that is no number misses it."""
        if self.goal is None:
            return None
        if self.median is None or any(map(math.isnan, self.samples)):
            return False
        judged = self.samples if self.every else (self.median,)
        return min(judged) >= self.goal if self.at_least else max(judged) <= self.goal

    def as_dict(self) -> dict[str, Any]:
        """Returns the row for JSON."""
        return {**asdict(self), "median": self.median, "holds": self.holds}


def table(rows: Sequence[Row]) -> str:
    """Returns the rows as a Markdown table."""
    return markdown([("what", "median", "range", "unit", "goal", "holds"), *map(_cells, rows)])


def markdown(lines: Sequence[Sequence[str]], right: bool = False) -> str:
    """Returns rows of cells, headings first, as a Markdown table; ``right`` aligns the cells to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    head, *rest = (
        " | ".join(
            f"{text:{'>' if right else '<'}{width}}"
            for text, width in zip(line, widths, strict=True)
        )
        for line in lines
    )
    rule = "|".join("-" * (width + 1) + (":" if right else "-") for width in widths)
    return "\n".join((f"| {head} |", f"|{rule}|", *(f"| {line} |" for line in rest)))


def _cells(row: Row) -> tuple[str, ...]:
    if row.median is None:
        return (
            row.what,
            "-",
            row.remark,
            row.unit,
            "" if row.goal is None else _number(row.goal),
            "no",
        )
    span = f"{_number(min(row.samples))} … {_number(max(row.samples))}"
    goal = "" if row.goal is None else f"{'≥' if row.at_least else '≤'} {_number(row.goal)}"
    if goal and row.remark:
        goal += f" ({row.remark})"
    return (
        row.what,
        _number(row.median),
        span,
        row.unit,
        goal,
        {None: "", True: "yes", False: "no"}[row.holds],
    )


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
