"""Figures of a bench: rows of samples beside their goals, and the table of them."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Row:
    """One figure.

    Attributes:
        what: what was measured.
        unit: of samples and goal.
        samples: one for each repetition; none where it could not be measured.
        goal: what the median is to reach; None where the row is there to compare with.
        every: whether each sample is to reach the goal, not only the median.
        at_least: whether more is better.
        remark: where the goal comes from, or what went wrong.
    """

    what: str
    unit: str
    samples: tuple[float, ...]
    goal: float | None = None
    at_least: bool = False
    remark: str = ""
    every: bool = False

    @property
    def median(self) -> float | None:
        """The middle sample."""
        return statistics.median(self.samples) if self.samples else None

    @property
    def holds(self) -> bool | None:
        """Whether the goal is reached; None where there is none."""
        if self.goal is None:
            return None
        if self.median is None:
            return False
        judged = self.samples if self.every else (self.median,)
        return min(judged) >= self.goal if self.at_least else max(judged) <= self.goal

    def as_dict(self) -> dict[str, Any]:
        """Returns the row for JSON."""
        return {
            "what": self.what,
            "unit": self.unit,
            "samples": list(self.samples),
            "median": self.median,
            "goal": self.goal,
            "at_least": self.at_least,
            "every": self.every,
            "holds": self.holds,
            "remark": self.remark,
        }


def table(rows: Sequence[Row]) -> str:
    """Returns the rows as a Markdown table."""
    cells = [("what", "median", "range", "unit", "goal", "holds"), *(_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)) + " |" for line in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def _cells(row: Row) -> tuple[str, ...]:
    if row.median is None:
        return row.what, "-", row.remark, row.unit, "" if row.goal is None else _number(row.goal), "no"
    span = f"{_number(min(row.samples))} … {_number(max(row.samples))}"
    goal = "" if row.goal is None else f"{'≥' if row.at_least else '≤'} {_number(row.goal)}"
    if goal and row.remark:
        goal += f" ({row.remark})"
    return row.what, _number(row.median), span, row.unit, goal, {None: "", True: "yes", False: "no"}[row.holds]


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
