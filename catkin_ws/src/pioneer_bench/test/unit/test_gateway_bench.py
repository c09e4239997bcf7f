"""Goals and result table of the gateway bench."""

import contextlib
import json
from pathlib import Path

import pytest

from pioneer_bench.adapters.fleet import Fleet
from pioneer_bench.core.gateway import (
    Flow,
    brisk_rows,
    encrypted_rows,
    large_rows,
    paced_rows,
    steady_rows,
)
from pioneer_bench.core.row import Row, table


def flows(gateway_cpu: float, p99: float = 0.001) -> dict[str, list[Flow]]:
    direct = Flow(1000.0, 1e9, 0.0, 0.0002, 0.0005)
    peer = Flow(500.0, 5e8, 0.5, 0.0004, 0.001)
    gateway = Flow(950.0, 9.5e8, gateway_cpu, 0.0004, p99)
    return {"direct": [direct], "topic_tools": [peer], "gateway": [gateway]}


@pytest.mark.parametrize(("at_least", "holds"), [(True, False), (False, True)])
def test_a_median_is_held_against_its_goal(at_least: bool, holds: bool) -> None:
    assert Row("a", "s", (0.1, 0.2, 9.0), 0.3, at_least).holds is holds
    assert Row("a", "s", (0.1, 0.2, 9.0)).holds is None


def test_what_could_not_be_measured_misses_its_goal() -> None:
    assert Row("a", "s", (), 0.3).holds is False
    assert "| no" in table([Row("a", "s", (), 0.3)])


@pytest.mark.parametrize("rows_from", [brisk_rows, large_rows, paced_rows])
def test_what_is_carried_for_more_cpu_than_the_peer_needs_misses_its_goal(rows_from) -> None:
    assert all(row.holds is not False for row in rows_from(flows(0.5)))
    assert next(row.unit for row in rows_from(flows(2.0)) if row.holds is False).endswith("/CPU-s")


def test_what_tls_costs_has_no_goal() -> None:
    rows = encrypted_rows(flows(0.5)["gateway"])
    assert [(row.unit, row.samples, row.holds) for row in rows] == [
        ("MB/s", (950.0,), None),
        ("MB/CPU-s", (1900.0,), None),
    ]


def test_latency_is_held_against_a_direct_connection() -> None:
    assert steady_rows(flows(0.5, 0.0007))[-1].holds
    assert not steady_rows(flows(0.5, 0.0008))[-1].holds


def test_a_row_says_median_range_and_goal() -> None:
    row = Row("call", "s", (0.1, 0.2, 0.4), 0.3, remark="peer")
    assert table([row]).splitlines()[2].replace(" ", "") == "|call|0.2|0.1…0.4|s|≤0.3(peer)|yes|"
    assert json.loads(json.dumps(row.as_dict()))["median"] == 0.2


def test_a_fleet_does_not_read_what_another_one_in_the_same_folder_has_printed(
    tmp_path: Path,
) -> None:
    """The rows of the hub with a password repeated those of the hub without one, which had logs of the same names."""
    for _ in range(2):
        with contextlib.closing(Fleet(tmp_path)) as fleet:
            process = fleet.base.run("crowd", ["echo", "ready"])
            process.end()
            assert process.lines() in ([], ["ready"])
