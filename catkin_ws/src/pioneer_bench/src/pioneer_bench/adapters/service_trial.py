"""The duration of a service call: directly, and through two gateways."""

import statistics
import time
from collections.abc import Iterator

from gateway_msgs.srv import ConnectHub

from pioneer_bench.adapters.fleet import PATIENCE, Fleet, Site, cpu
from pioneer_bench.core.row import Row
from pioneer_harness.wait import wait_until

SERVICE = "/echo"
CALLS = 100
"""Calls in one sample."""


def service_rows(fleet: Fleet, repetitions: int) -> list[Row]:
    """Returns the rows of successive calls of 100 bytes, each on its own connection or all on one."""
    ways = {"direct": fleet.robot, "gateway": fleet.base}
    fleet.robot.ask("flip", "base", "service", SERVICE)
    rows = []
    with fleet.robot.running("serve", SERVICE):
        for site in ways.values():
            wait_until(lambda s=site: s.serves(SERVICE), f"{SERVICE} at {site.name}", PATIENCE)
        for what, persistent in (("a connection each", False), ("one connection", True)):
            for way, site in ways.items():
                samples = tuple(_latency(site, persistent) for _ in range(repetitions))
                rows.append(Row(f"service call, {what}, {way}: p50", "ms", samples))
            spent = tuple(_spent(fleet, persistent) for _ in range(repetitions))
            rows.append(Row(f"service call, {what}, gateways (both)", "CPU-ms", spent))
    fleet.robot.ask("flip", "base", "service", SERVICE, cancel=True)
    return rows


def _latency(site: Site, persistent: bool) -> float:
    return statistics.median(_times(site, persistent))


def _spent(fleet: Fleet, persistent: bool) -> float:
    pids = [fleet.base.gateway.pid, fleet.robot.gateway.pid]
    before = cpu(pids)
    calls = len(list(_times(fleet.base, persistent)))
    return 1e3 * (cpu(pids) - before) / calls


def _times(site: Site, persistent: bool) -> Iterator[float]:
    """Yields the duration of each call [ms]."""
    if persistent:
        with site.service(SERVICE, ConnectHub, True) as connection:
            for _ in range(CALLS):
                begin = time.perf_counter()
                connection.call(ConnectHub, uri="x" * 96)
                yield 1e3 * (time.perf_counter() - begin)
        return
    for _ in range(CALLS):
        begin = time.perf_counter()
        with site.service(SERVICE, ConnectHub, False) as connection:
            connection.call(ConnectHub, uri="x" * 96)
        yield 1e3 * (time.perf_counter() - begin)
