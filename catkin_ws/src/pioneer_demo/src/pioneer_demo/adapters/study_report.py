"""Writes a study's report: table, summary and HTML page."""

import base64
import html
import io
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas

from pioneer_demo.core.comparison import frame_of, summary_of
from pioneer_demo.core.study import METRICS, Study

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #2f3640 }}
table {{ border-collapse: collapse }} th, td {{ padding: .25em .8em; border-bottom: 1px solid #ddd; text-align: right }}
th:first-child, td:first-child {{ text-align: left }} img {{ max-width: 100% }}
</style></head><body>
<h1>{title}</h1><p>{about}</p>
<p>{runs} runs of the scenario {scenario}. Success rates, and medians of the metrics, with intervals of 95 %: exact ones
for rates, the sign test's for medians, which needs six values. Time and path length are of runs in which every robot
reached all its waypoints; a run without that end counts as worse than all others (∞), and n says how many have one.</p>
<h2>Variants</h2>{table}
<h2>Differences to {baseline}, by seed</h2>{differences}
<h2>Figures</h2><img src="data:image/png;base64,{figure}" alt="success rate and metrics by variant">
<h2>Runs without success</h2>{failures}
</body></html>
"""


def write_report(study: Study, rows: list[dict[str, Any]], folder: Path) -> None:
    """Writes ``runs.csv``, ``summary.json`` and ``report.html`` into a study's folder."""
    table = frame_of(rows, list(study.variants))
    summary = {"scenario": study.scenario, **summary_of(table)}
    table.to_csv(folder / "runs.csv", index=False)
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    (folder / "report.html").write_text(_page(study, table, summary, folder.resolve().name))


def _page(study: Study, table: pandas.DataFrame, summary: dict[str, Any], title: str) -> str:
    variants = summary["variants"]
    head = ["variant", "runs", "success", *METRICS.values()]
    rows = [
        [name, str(one["runs"]), _rate(one["success"]), *(_interval(one["metrics"][metric]) for metric in METRICS)]
        for name, one in variants.items()
    ]
    others = {name: one["difference"] for name, one in variants.items() if "difference" in one}
    gaps = [
        [name, _rate_gap(one["success"]), *(_interval(one[metric]) for metric in METRICS)]
        for name, one in others.items()
    ]
    failed = table[~table["success"]]
    said = [[str(one.variant), str(one.seed), str(one.faults)] for one in failed.itertuples()]
    return _PAGE.format(
        title=html.escape(title),
        about=html.escape(study.about),
        runs=len(table),
        scenario=html.escape(study.scenario),
        baseline=html.escape(str(summary["baseline"])),
        table=_table(head, rows),
        differences=_table(["variant", "success", *METRICS.values()], gaps) if gaps else "<p>There is one variant.</p>",
        failures=_table(["variant", "seed", "what failed"], said) if said else "<p>None.</p>",
        figure=_figure(table, variants),
    )


def _rate(rate: dict[str, Any]) -> str:
    if not rate["count"] and "rate" not in rate:
        return "–"
    return f"{100 * rate['rate']:.0f} % ({100 * rate['low']:.0f} … {100 * rate['high']:.0f})"


def _rate_gap(gap: dict[str, Any]) -> str:
    if not gap["count"]:
        return "–"
    return f"{100 * gap['mean']:+.0f} % ({100 * gap['low']:+.0f} … {100 * gap['high']:+.0f})"


def _interval(figures: dict[str, Any]) -> str:
    """Returns a median with its interval, and the number of runs it is of if some have no end."""
    if "median" not in figures:
        return "–"
    bounds = f" ({_bound(figures['low'], '−')} … {_bound(figures['high'])})" if "low" in figures else ""
    count = figures["count"]
    runs = f", n = {count} of {count + figures['unfinished']}" if figures.get("unfinished") else ""
    return f"{_bound(figures['median'])}{bounds}{runs}"


def _bound(value: float | None, sign: str = "") -> str:
    return f"{sign}∞" if value is None else f"{value:.3g}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    def line(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{line(head, 'th')}{''.join(line(row, 'td') for row in rows)}</table>"


def _figure(table: pandas.DataFrame, variants: dict[str, Any]) -> str:
    """Returns a base64-encoded PNG with the success rates and each metric's distribution by variant."""
    mpl.use("Agg")
    from matplotlib import pyplot

    figure, places = pyplot.subplots(3, 4, figsize=(16.0, 10.0), layout="constrained")
    axes = iter(places.flat)
    first, names = next(axes), list(variants)
    for number, one in enumerate(variants.values()):
        if "rate" in (rate := one["success"]):
            first.plot([number, number], [rate["low"], rate["high"]], color=f"C{number}", linewidth=2)
            first.plot(number, rate["rate"], "o", color=f"C{number}")
    first.set(title="success rate", ylim=(-0.05, 1.05), xlim=(-0.5, len(names) - 0.5))
    first.set_xticks(range(len(names)), names)
    for metric, title in METRICS.items():
        own = next(axes)
        own.boxplot([table[table["variant"] == name][metric].dropna() for name in names], showmeans=True)
        own.set_xticks(range(1, len(names) + 1), names)
        own.set(title=title)
    for unused in axes:
        unused.axis("off")
    output = io.BytesIO()
    figure.savefig(output, dpi=90)
    pyplot.close(figure)
    return base64.b64encode(output.getvalue()).decode()
