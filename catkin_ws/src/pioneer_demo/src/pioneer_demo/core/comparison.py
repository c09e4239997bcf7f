"""Statistics of a study: success rates with Wilson intervals, and paired differences of variants by seed."""

from typing import Any

import numpy as np
import pandas
from numpy.typing import NDArray
from scipy import stats

from pioneer_demo.core.study import METRICS

_CONFIDENCE = 0.95
_RESAMPLES = 2000


def frame_of(rows: list[dict[str, Any]], variants: list[str]) -> pandas.DataFrame:
    """Returns the rows as a table, sorted by variant and seed; metrics missing in rows of older releases are empty."""
    table = pandas.DataFrame([{**dict.fromkeys(METRICS), **row} for row in rows])
    table["variant"] = pandas.Categorical(table["variant"], categories=variants, ordered=True)
    for metric in METRICS:
        table[metric] = pandas.to_numeric(table[metric])
    return table.sort_values(["variant", "seed"], ignore_index=True)


def summary_of(table: pandas.DataFrame) -> dict[str, Any]:
    """Returns, for each variant, number of runs, success rate, metrics, and differences to the first variant.

    All intervals are 95 %: Wilson for rates, else percentile bootstrap of the mean (2000 resamples). Differences are
    paired by seed, over the seeds for which both variants have the value.
    """
    first = table["variant"].cat.categories[0]
    base = table[table["variant"] == first].set_index("seed")
    variants = {}
    for name in table["variant"].cat.categories:
        own = table[table["variant"] == name].set_index("seed")
        variants[name] = {
            "runs": len(own),
            "success": _rate(int(own["success"].sum()), len(own)),
            "metrics": {metric: _mean(own[metric].dropna().to_numpy(float)) for metric in METRICS},
        }
        if name != first:
            gaps = {metric: (own[metric] - base[metric]).dropna().to_numpy(float) for metric in METRICS}
            rate = (own["success"].astype(float) - base["success"].astype(float)).dropna().to_numpy(float)
            variants[name]["difference"] = {m: _mean(gap) for m, gap in {"success": rate, **gaps}.items()}
    return {"baseline": first, "confidence": _CONFIDENCE, "variants": variants}


def _rate(successes: int, runs: int) -> dict[str, float | int]:
    if not runs:
        return {"count": 0}
    bounds = stats.binomtest(successes, runs).proportion_ci(_CONFIDENCE, method="wilson")
    return {"count": successes, "rate": successes / runs, "low": float(bounds.low), "high": float(bounds.high)}


def _mean(values: NDArray[np.float64]) -> dict[str, float | int]:
    """Returns count, mean and the mean's interval; the interval needs at least two values."""
    if not values.size:
        return {"count": 0}
    found: dict[str, float | int] = {"count": int(values.size), "mean": float(values.mean())}
    if values.size > 1:
        # Fixed seed, so that the same rows give the same interval.
        bounds = stats.bootstrap(
            (values,), np.mean, confidence_level=_CONFIDENCE, n_resamples=_RESAMPLES, method="percentile",
            random_state=np.random.default_rng(1),
        ).confidence_interval  # fmt: skip
        found |= {"low": float(bounds.low), "high": float(bounds.high)}
    return found
