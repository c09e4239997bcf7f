"""The gateway's results: rows of samples beside their goals."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from pioneer_bench.core.row import Row


@dataclass(frozen=True, slots=True)
class Flow:
    """What one subscriber received in one window, and the cost of carrying it."""

    messages: float  #: received a second
    bytes: float  #: received a second
    cpu: float  #: of the carrying processes, CPU-s a second; 0 for a direct connection
    p50: float  #: median latency [s]
    p99: float  #: 99th percentile of the latency [s]


Flows = dict[str, list[Flow]]
"""Measured windows by way: `direct`, `topic_tools`, `gateway`."""


def small_rows(flows: Flows) -> list[Row]:
    """Returns the rows of short messages at full speed."""
    what = "100 B flat out"
    arrived = [
        Row(f"{what}, {way}: arrived", "msg/s", _samples(flows[way], "messages")) for way in flows
    ]
    own = _samples(flows["gateway"], "messages", "cpu")
    return [*arrived, Row(f"{what}, gateways (both)", "msg/CPU-s", own)]


def brisk_rows(flows: Flows) -> list[Row]:
    """Returns the rows of short messages at the highest rate that every way can follow."""
    what = "100 B at 10 kHz"
    arrived = [
        Row(f"{what}, {way}: arrived", "msg/s", _samples(flows[way], "messages")) for way in flows
    ]
    return [*arrived, *_per_cpu(what, "msg", flows, "messages", 1.0, "more than topic_tools")]


def large_rows(flows: Flows) -> list[Row]:
    """Returns the rows of long messages at full speed."""
    what = "1 MB flat out"
    rates = {way: _samples(flows[way], "bytes", scale=1e-6) for way in flows}
    direct = _median(rates["direct"])
    aim = None if direct is None else 0.9 * direct
    return [
        Row(f"{what}, direct", "MB/s", rates["direct"]),
        Row(f"{what}, topic_tools (one hop)", "MB/s", rates["topic_tools"]),
        Row(
            f"{what}, gateways",
            "MB/s",
            rates["gateway"],
            _median(rates["topic_tools"]),
            True,
            "topic_tools",
        ),
        Row(f"{what}, gateways, the aim", "MB/s", rates["gateway"], aim, True, "90 % of direct"),
        *_per_cpu(what, "MB", flows, "bytes", 1e-6),
    ]


def encrypted_rows(flows: Sequence[Flow]) -> list[Row]:
    """Returns the rows of long messages at full speed through gateways with TLS; they have no goal."""
    return [
        Row("1 MB flat out, gateways with TLS", "MB/s", _samples(flows, "bytes", scale=1e-6)),
        Row(
            "1 MB flat out, gateways with TLS (both)",
            "MB/CPU-s",
            _samples(flows, "bytes", "cpu", 1e-6),
        ),
    ]


def paced_rows(flows: Flows) -> list[Row]:
    """Returns the rows of long messages at a rate that every way can follow."""
    what = "1 MB at 50 Hz"
    rows = [
        Row(f"{what}, {way}: arrived", "MB/s", _samples(flows[way], "bytes", scale=1e-6))
        for way in flows
    ]
    rows += [
        Row(f"{what}, {way}: p50", "ms", _samples(flows[way], "p50", scale=1e3)) for way in flows
    ]
    return [*rows, *_per_cpu(what, "MB", flows, "bytes", 1e-6)]


def steady_rows(flows: Flows) -> list[Row]:
    """Returns the rows of latency: short messages at 100 Hz."""
    p99 = {way: _samples(flows[way], "p99", scale=1e3) for way in flows}
    direct = _median(p99["direct"])
    goal = None if direct is None else 1.5 * direct
    rows = [
        Row(f"100 B at 100 Hz, {way}: p50", "ms", _samples(flows[way], "p50", scale=1e3))
        for way in flows
    ]
    rows += [
        Row(f"100 B at 100 Hz, {way}: p99", "ms", p99[way]) for way in flows if way != "gateway"
    ]
    return [
        *rows,
        Row("100 B at 100 Hz, gateway: p99", "ms", p99["gateway"], goal, False, "1.5 × direct"),
    ]


def _per_cpu(
    what: str, unit: str, flows: Flows, name: str, scale: float, remark: str = "topic_tools"
) -> tuple[Row, Row]:
    """Returns the rows of throughput per CPU-second; the goal is that the gateways match topic_tools."""
    peer, own = (_samples(flows[way], name, "cpu", scale) for way in ("topic_tools", "gateway"))
    return (
        Row(f"{what}, topic_tools (one hop)", f"{unit}/CPU-s", peer),
        Row(f"{what}, gateways (both)", f"{unit}/CPU-s", own, _median(peer), True, remark),
    )


def _samples(
    flows: Sequence[Flow], name: str, over: str = "", scale: float = 1.0
) -> tuple[float, ...]:
    return tuple(
        scale * getattr(flow, name) / (max(getattr(flow, over), 1e-6) if over else 1.0)
        for flow in flows
    )


def _median(samples: Sequence[float]) -> float | None:
    return statistics.median(samples) if samples else None
