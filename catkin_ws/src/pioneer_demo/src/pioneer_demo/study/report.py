"""Writes a study's report: table, summary and HTML page."""

import html
import io
import json
import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas

from pioneer_demo.study.comparison import frame_of, summary_of
from pioneer_demo.study.study import METRICS, Study

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
@page {{ size: A4 landscape; margin: 12mm }}
body {{ font: 15px/1.5 sans-serif; max-width: 80em; margin: 2em auto; padding: 0 1em; color: #2f3640 }}
table {{ border-collapse: collapse }} th, td {{ padding: .25em .8em; border-bottom: 1px solid #ddd; text-align: right }}
th:first-child, td:first-child {{ text-align: left }} th {{ cursor: pointer }} svg {{ max-width: 100%; height: auto }}
@media print {{ body {{ font-size: 9px; margin: 0 }} table, svg {{ break-inside: avoid }} }}
</style></head><body>
<h1>{title}</h1><p>{about}</p>
<p>{runs} runs of the scenario {scenario}. Success rates, and medians of the metrics, with intervals of 95 %: exact ones
for rates, the sign test's for medians, which needs six values. Time and path length are of runs in which every robot
reached all its waypoints; a run without that end counts as worse than all others (∞), and n says how many have one.</p>
<h2>Variants</h2>{table}
<h2>Differences to {baseline}, by seed</h2>{differences}
{forest}
<h2>Figures</h2>{figure}
<h2>Runs without success</h2>{failures}
<h2>Data</h2><p>All runs: <a href="runs.csv">runs.csv</a>; the figures of this page:
<a href="summary.json">summary.json</a>. To repeat the study: <code>{command}</code></p>
<script>
for (const head of document.querySelectorAll("th")) head.onclick = () => {{
  const body = head.closest("table").tBodies[0], column = head.cellIndex;
  const up = head.dataset.up = head.dataset.up ? "" : 1;
  const value = row => {{ const text = row.cells[column].textContent.replace("−", "-");
    return isNaN(parseFloat(text)) ? text : parseFloat(text); }};
  const rows = [...body.rows].sort((a, b) => (value(a) > value(b) ? 1 : -1) * (up ? 1 : -1));
  body.append(...rows);
}};
</script>
</body></html>
"""
_NOTHING = "–"


def write_report(
    study: Study, rows: list[dict[str, Any]], folder: Path, name: str, command: str
) -> None:
    """Writes ``runs.csv``, ``summary.json`` and ``report.html`` into a study's folder.

    Args:
        study: the study.
        rows: a row of metrics for each run.
        folder: where to write.
        name: the study's name, which becomes the title.
        command: the command that repeats it.
    """
    table = frame_of(rows, list(study.variants))
    summary = {"scenario": study.scenario, **summary_of(table)}
    table.to_csv(folder / "runs.csv", index=False)
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    (folder / "report.html").write_text(_page(study, table, summary, name, command))


def _page(
    study: Study, table: pandas.DataFrame, summary: dict[str, Any], name: str, command: str
) -> str:
    mpl.use("Agg")
    variants = summary["variants"]
    rows = [
        [
            variant,
            str(one["runs"]),
            _rate(one["success"]),
            *(_interval(one["metrics"][metric]) for metric in METRICS),
        ]
        for variant, one in variants.items()
    ]
    others = {
        variant: one["difference"] for variant, one in variants.items() if "difference" in one
    }
    gaps = [
        [variant, _rate_gap(one["success"]), *(_interval(one[metric], "+") for metric in METRICS)]
        for variant, one in others.items()
    ]
    failed = table[~table["success"]]
    reasons = [[str(run.variant), str(run.seed), str(run.faults)] for run in failed.itertuples()]
    return _PAGE.format(
        title=html.escape(name),
        about=html.escape(study.about),
        runs=len(table),
        scenario=html.escape(study.scenario),
        baseline=html.escape(str(summary["baseline"])),
        table=_table(["variant", "runs", "success", *METRICS.values()], rows),
        differences=_table(["variant", "success", *METRICS.values()], gaps)
        if gaps
        else "<p>There is one variant.</p>",
        forest=_forest(variants, str(summary["baseline"])),
        failures=_table(["variant", "seed", "what failed"], reasons) if reasons else "<p>None.</p>",
        figure=_figure(table, variants),
        command=html.escape(command),
    )


def _rate(rate: dict[str, Any]) -> str:
    if not rate["count"] and "rate" not in rate:
        return "–"
    return f"{100 * rate['rate']:.0f} % ({100 * rate['low']:.0f} … {100 * rate['high']:.0f})"


def _rate_gap(gap: dict[str, Any]) -> str:
    if not gap["count"]:
        return "–"
    text = f"{100 * gap['mean']:+.0f} % ({100 * gap['low']:+.0f} … {100 * gap['high']:+.0f})"
    return text.replace("-", "−")


def _interval(figures: dict[str, Any], sign: str = "") -> str:
    """Returns a median with its interval, and the number of runs it is of if some have no end.

    Args:
        figures: of one metric.
        sign: ``+`` for a difference, whose positive values get a sign.
    """
    if "median" not in figures:
        return _NOTHING
    bounds = [figures[name] for name in ("low", "high") if name in figures]
    finite = [bound for bound in bounds if bound is not None]
    # As in a paper: two digits of the interval's width, or three of the value without one.
    width = finite[1] - finite[0] if len(finite) == 2 and finite[1] > finite[0] else None
    scale = width if width is not None else abs(figures["median"] or 0.0) / 10.0
    decimals = max(0, 1 - math.floor(math.log10(scale))) if scale else 0

    def shown(value: float | None, side: str = "") -> str:
        return f"{side}∞" if value is None else f"{value:{sign}.{decimals}f}".replace("-", "−")

    interval = f" ({shown(bounds[0], '−' if sign else '')} … {shown(bounds[1])})" if bounds else ""
    count = figures["count"]
    runs = f", n = {count} of {count + figures['unfinished']}" if figures.get("unfinished") else ""
    return f"{shown(figures['median'])}{interval}{runs}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    def line(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def _forest(variants: dict[str, Any], baseline: str) -> str:
    """Returns an SVG with all differences that have an interval, each as a share of the baseline's median."""
    bars: list[tuple[str, list[float]]] = []
    for name, one in variants.items():
        gaps = one.get("difference", {})
        rate = gaps.get("success", {})
        if "low" in rate:
            bars.append(
                (f"{name}: success", [100.0 * rate[part] for part in ("mean", "low", "high")])
            )
        for metric, title in METRICS.items():
            gap = gaps.get(metric, {})
            base = variants[baseline]["metrics"][metric].get("median")
            values = [gap.get(part) for part in ("median", "low", "high")]
            if base and None not in values:
                bars.append(
                    (
                        f"{name}: {title.partition(' [')[0]}",
                        [100.0 * value / base for value in values],
                    )
                )
    if not bars:
        return ""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(10.0, 0.8 + 0.3 * len(bars)), layout="constrained")
    for row, (_, (middle, low, high)) in enumerate(bars):
        axes.plot([low, high], [row, row], color="C0", linewidth=2)
        axes.plot(middle, row, "o", color="C0")
    axes.axvline(0.0, color="grey", linewidth=1)
    axes.set_yticks(range(len(bars)), [title for title, _ in bars])
    axes.invert_yaxis()
    axes.set_xlabel(f"difference to {baseline} [% of its median; of success, percentage points]")
    return _svg(figure)


def _figure(table: pandas.DataFrame, variants: dict[str, Any]) -> str:
    """Returns an SVG with the success rates and the distribution of each metric that varies, by variant."""
    from matplotlib import pyplot

    varying = [metric for metric in METRICS if table[metric].nunique() > 1]
    columns = min(4, 1 + len(varying))
    rows = math.ceil((1 + len(varying)) / columns)
    figure, places = pyplot.subplots(
        rows, columns, figsize=(4.0 * columns, 3.3 * rows), layout="constrained", squeeze=False
    )
    axes = iter(places.flat)
    first = next(axes)
    names = list(variants)
    for number, one in enumerate(variants.values()):
        if "rate" in (rate := one["success"]):
            first.plot(
                [number, number], [rate["low"], rate["high"]], color=f"C{number}", linewidth=2
            )
            first.plot(number, rate["rate"], "o", color=f"C{number}")
    first.set(title="success rate", ylim=(-0.05, 1.05), xlim=(-0.5, len(names) - 0.5))
    first.set_xticks(range(len(names)), names)
    for metric in varying:
        own = next(axes)
        own.boxplot(
            [table[table["variant"] == name][metric].dropna() for name in names], showmeans=True
        )
        own.set_xticks(range(1, len(names) + 1), names)
        own.set(title=METRICS[metric])
    for unused in axes:
        unused.axis("off")
    return _svg(figure)


def _svg(figure: Any) -> str:
    """Returns a figure as an SVG element, and closes it."""
    from matplotlib import pyplot

    output = io.StringIO()
    figure.savefig(output, format="svg")
    pyplot.close(figure)
    text = output.getvalue()
    return text[text.index("<svg") :]
