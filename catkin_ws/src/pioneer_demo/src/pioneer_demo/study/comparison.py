"""Statistics of a study, with intervals that hold whatever the distribution of the metrics is.

- Rates: Clopper and Pearson's exact interval.
- Metrics: the median, with the interval of the sign test (order statistics). It covers the true median in at least
  95 % of all studies, and does not exist for fewer than six values: so few cannot give it.
- Differences to the first variant: the same for the differences of runs with the same seed.

A run without an end has no time and no path length; it counts as worse than every run that has ended. Means are of the
runs that have ended, and have no interval.
"""

import math
from typing import Any

import numpy as np
import pandas
from numpy.typing import NDArray
from scipy import stats

from pioneer_demo.study.study import CENSORED, METRICS

CONFIDENCE = 0.95


def frame_of(rows: list[dict[str, Any]], variants: list[str]) -> pandas.DataFrame:
    """Returns the rows as a table, sorted by variant and seed; metrics missing in rows of older releases are empty."""
    default: dict[str, Any] = {**dict.fromkeys(METRICS), "finished": True}
    table = pandas.DataFrame([{**default, **row} for row in rows])
    table["variant"] = pandas.Categorical(table["variant"], categories=variants, ordered=True)
    for name in ("success", "finished"):
        table[name] = table[name].astype(bool)
    for metric in METRICS:
        table[metric] = pandas.to_numeric(table[metric])
    return table.sort_values(["variant", "seed"], ignore_index=True)


def summary_of(table: pandas.DataFrame) -> dict[str, Any]:
    """Returns, for each variant, number of runs, success rate, metrics, and differences to the first variant.

    A metric has ``count``, the number of values, ``mean`` and ``median``, and the median's interval, ``low`` to
    ``high``, if there are values enough for one. Time and path length have ``unfinished`` too, the number of runs
    without an end; a bound is None if it is beyond every run that has ended. Differences are paired by seed, over the
    seeds for which both variants have the value, or at least one has an end.
    """
    first = table["variant"].cat.categories[0]
    base = table[table["variant"] == first].set_index("seed")
    variants = {}
    for name in table["variant"].cat.categories:
        own = table[table["variant"] == name].set_index("seed")
        variants[name] = {
            "runs": len(own),
            "success": rate(int(own["success"].sum()), len(own)),
            "metrics": {metric: _figures(metric, _values(own, metric)) for metric in METRICS},
        }
        if name != first:
            seeds = own.index.intersection(base.index)
            ours = own.loc[seeds]
            theirs = base.loc[seeds]
            gained = int((ours["success"] & ~theirs["success"]).sum())
            lost = int((theirs["success"] & ~ours["success"]).sum())
            variants[name]["difference"] = {
                "success": rate_difference(gained, lost, len(seeds)),
                **{metric: _figures(metric, _gaps(metric, ours, theirs)) for metric in METRICS},
            }
    return {"baseline": first, "confidence": CONFIDENCE, "variants": variants}


def rate(successes: int, runs: int) -> dict[str, float | int]:
    """Returns a rate with its exact interval; only the count if there are no runs."""
    if not runs:
        return {"count": 0}
    bounds = stats.binomtest(successes, runs).proportion_ci(CONFIDENCE, method="exact")
    return {
        "count": successes,
        "rate": successes / runs,
        "low": float(bounds.low),
        "high": float(bounds.high),
    }


def rate_difference(gained: int, lost: int, runs: int) -> dict[str, float | int]:
    """Returns the difference of two variants' success rates, over pairs of runs with the same seed.

    Its interval is made of the exact intervals of two rates, each with half of the error. Closer ones, such as
    Newcombe's, cover less than 70 % where the two variants mostly succeed and fail together.

    Args:
        gained: number of pairs in which only this variant succeeded.
        lost: number of pairs in which only the first variant succeeded.
        runs: number of pairs.
    """
    if not runs:
        return {"count": 0}
    level = 1.0 - (1.0 - CONFIDENCE) / 2.0
    gain = stats.binomtest(gained, runs).proportion_ci(level, method="exact")
    loss = stats.binomtest(lost, runs).proportion_ci(level, method="exact")
    return {
        "count": runs,
        "mean": (gained - lost) / runs,
        "low": float(gain.low - loss.high),
        "high": float(gain.high - loss.low),
    }


def median_interval(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """Returns the interval of the median of the values' distribution; None if they are too few.

    Args:
        values: independent values of one distribution; they may be infinite.
    """
    # The number of values below the true median has the distribution of heads among as many coins.
    rank = int(stats.binom.ppf((1.0 - CONFIDENCE) / 2.0, values.size, 0.5))
    if rank == 0:
        return None
    ordered = np.sort(values)
    return float(ordered[rank - 1]), float(ordered[-rank])


def _values(runs: pandas.DataFrame, metric: str) -> NDArray[np.float64]:
    """Returns the metric of the runs that have it; infinite for a run without an end, if that censors the metric."""
    values = runs[metric].to_numpy(float)
    if metric in CENSORED:
        values = np.where(runs["finished"].to_numpy(bool), values, np.inf)
    return values[~np.isnan(values)]


def _gaps(metric: str, own: pandas.DataFrame, base: pandas.DataFrame) -> NDArray[np.float64]:
    """Returns the differences of two variants' runs, seed by seed; infinite if only one of the two has an end."""
    ours = own[metric].to_numpy(float)
    theirs = base[metric].to_numpy(float)
    gaps = ours - theirs
    if metric in CENSORED:
        we_ended = own["finished"].to_numpy(bool)
        they_ended = base["finished"].to_numpy(bool)
        gaps = np.where(they_ended & ~we_ended, np.inf, gaps)
        gaps = np.where(we_ended & ~they_ended, -np.inf, gaps)
    return gaps[~np.isnan(gaps)]


def _figures(metric: str, values: NDArray[np.float64]) -> dict[str, float | int | None]:
    """Returns the figures of one metric's values, of which infinite ones belong to runs without an end."""
    known = values[np.isfinite(values)]
    figures: dict[str, float | int | None] = {"count": int(known.size)}
    if metric in CENSORED:
        figures["unfinished"] = int(values.size - known.size)
    if known.size:
        figures["mean"] = float(known.mean())
    if not values.size:
        return figures
    figures["median"] = _finite(_median(values))
    bounds = median_interval(values)
    if bounds is not None:
        figures["low"] = _finite(bounds[0])
        figures["high"] = _finite(bounds[1])
    return figures


def _median(values: NDArray[np.float64]) -> float:
    """Returns the median; of an even number, infinite if one of the two in the middle is."""
    ordered = np.sort(values)
    lower = float(ordered[(values.size - 1) // 2])
    upper = float(ordered[values.size // 2])
    return lower if lower == upper else (lower + upper) / 2.0


def _finite(value: float) -> float | None:
    """Returns the value; None, which JSON has, for an infinite one."""
    return value if math.isfinite(value) else None
