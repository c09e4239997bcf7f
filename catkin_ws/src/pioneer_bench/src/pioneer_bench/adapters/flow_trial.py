"""The cost of messages and service calls, directly, by topic_tools' relay and by two gateways; the cost of idling."""

import contextlib
import json
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

from gateway_msgs.srv import ConnectHub

from pioneer_bench.adapters.fleet import PATIENCE, Fleet, Process, Site, cpu
from pioneer_bench.core.gateway import (
    Flow,
    Flows,
    brisk_rows,
    encrypted_rows,
    large_rows,
    paced_rows,
    small_rows,
    steady_rows,
)
from pioneer_bench.core.row import Row
from pioneer_harness.wait import wait_until
from tcpros.authority import Authority

TOPIC_TOOLS_RELAY = "/usr/lib/topic_tools/relay"
SERVICE = "/echo"
CALLS = 1000
"""Calls in one sample."""


def flow_rows(fleet: Fleet, repetitions: int, seconds: float) -> list[Row]:
    """Returns the rows of messages of 100 bytes and 1 MB, sent at full speed and at fixed rates."""
    # With a queue rospy batches short messages. Without one it blocks on the socket, which avoids dropping long ones.
    every = ("direct", "topic_tools", "gateway")
    kinds = (
        # At full speed topic_tools' subscriber drops nearly everything: compare it at a rate that it can follow.
        ("/small", 100, 0, 1000, small_rows, ("direct", "gateway")),
        ("/brisk", 100, 10_000, 1000, brisk_rows, ("topic_tools", "gateway")),
        ("/large", 1_000_000, 0, 0, large_rows, every),
        ("/paced", 1_000_000, 50, 10, paced_rows, every),
        ("/steady", 100, 100, 10, steady_rows, every),
    )
    rows = []
    for topic, size, rate, queue, rows_from, compared in kinds:
        with _carriers(fleet, topic, (size, rate, queue)) as ways:
            flows: Flows = {way: [] for way in compared}
            for _ in range(repetitions):
                for way in compared:
                    flows[way].append(_flow(*ways[way], seconds))
        rows += rows_from(flows)
    return rows


def tls_rows(folder: Path, repetitions: int, seconds: float) -> list[Row]:
    """Returns the rows of messages of 1 MB at full speed, through a separate fleet whose hub and links use TLS."""
    certificates = Authority(folder / "authority").certify("bench")
    with contextlib.closing(Fleet(folder, ROCON_TLS_DIRECTORY=str(certificates))) as fleet:
        fleet.start()
        with _carriers(fleet, "/large", (1_000_000, 0, 0)) as ways:
            return encrypted_rows([_flow(*ways["gateway"], seconds) for _ in range(repetitions)])


def idle_rows(fleet: Fleet, seconds: float) -> list[Row]:
    """Returns the rows of an idle gateway: on a hub, with one active rule and no subscribers."""
    fleet.base.ask("flip", "robot", "subscriber", "/idle")
    with fleet.robot.running("talk", "idle", "/idle", 100, 100, 10):
        wait_until(lambda: fleet.base.publishers("/idle"), "the proxy", PATIENCE)
        pids = [site.gateway.pid for site in (fleet.base, fleet.robot)]
        before, begin = [cpu([pid]) for pid in pids], time.monotonic()
        # Not a wait for a condition: this is the measured idle period.
        time.sleep(seconds)
        spent = [cpu([pid]) - early for pid, early in zip(pids, before, strict=True)]
        share = tuple(100 * one / (time.monotonic() - begin) for one in spent)
        status = [_status(pid) for pid in pids]
    fleet.base.ask("flip", "robot", "subscriber", "/idle", cancel=True)
    return [
        Row("idle gateway: CPU", "% of a core", share, 0.5),
        Row("idle gateway: threads", "", tuple(float(one["Threads"]) for one in status), 8),
        Row(
            "idle gateway: resident memory",
            "MB",
            tuple(float(one["VmRSS"]) / 1024 for one in status),
            25,
        ),
    ]


@contextlib.contextmanager
def _carriers(
    fleet: Fleet, topic: str, load: tuple[int, int, int]
) -> Iterator[dict[str, tuple[Site, str, list[Process]]]]:
    """Yields, by way, the subscriber's site, the topic there, and the processes in between."""
    fleet.base.ask("flip", "robot", "subscriber", topic)
    with fleet.robot.running("talk", "source", topic, *load):
        copy = f"{topic}_copy"
        argv = [TOPIC_TOOLS_RELAY, topic, copy, "__name:=topic_tools", "_lazy:=true"]
        relay = fleet.robot.run("topic_tools", argv)
        wait_until(lambda: fleet.base.publishers(topic), "the proxy", PATIENCE)
        yield {
            "direct": (fleet.robot, topic, []),
            "topic_tools": (fleet.robot, copy, [relay]),
            "gateway": (fleet.base, topic, [fleet.base.gateway, fleet.robot.gateway]),
        }
    fleet.base.ask("flip", "robot", "subscriber", topic, cancel=True)


def _flow(site: Site, topic: str, carriers: list[Process], seconds: float) -> Flow:
    pids = [process.pid for process in carriers]
    with site.running("hear", topic, seconds) as ear:
        wait_until(lambda: "begin" in ear.lines(), f"messages on {topic}", PATIENCE)
        before, begin = cpu(pids), time.monotonic()
        wait_until(lambda: ear.lines()[-1].startswith("{"), "the window's end", seconds + PATIENCE)
        spent = (cpu(pids) - before) / (time.monotonic() - begin)
        return Flow(cpu=spent, **json.loads(ear.lines()[-1]))


def _status(pid: int) -> dict[str, str]:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {
        key: value.split()[0]
        for key, _, value in (line.partition(":") for line in lines)
        if value.strip()
    }


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
                samples = tuple(
                    statistics.median(_times(site, persistent)) for _ in range(repetitions)
                )
                rows.append(Row(f"service call, {what}, {way}: p50", "ms", samples))
            spent = tuple(_spent(fleet, persistent) for _ in range(repetitions))
            rows.append(Row(f"service call, {what}, gateways (both)", "CPU-ms", spent))
    fleet.robot.ask("flip", "base", "service", SERVICE, cancel=True)
    return rows


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
