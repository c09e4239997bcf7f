"""The bench of the door to ROS 2: which topics it carries, and which figures miss their goals."""

import re
from pathlib import Path

import pytest
import rospkg
from roslib.message import get_message_class

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

from pioneer_bench.core.comparison import Scale, figures_of
from pioneer_bench.core.door import (
    BRIDGE,
    DOOR,
    Carried,
    FleetCost,
    Received,
    carried_rows,
    conversion_rows,
    fleet_rows,
    fleet_streams,
    image_stream,
    latency_rows,
    pose_stream,
    scan_stream,
)
from pioneer_bench.core.row import Row
from pioneer_bench.nodes.stand_in import serialised_example
from pioneer_ros2.message import MessageTypes
from pioneer_ros2.rule import exports, rules_from_mapping

ROBOTS = 3


def rules():
    import yaml

    path = Path(rospkg.RosPack().get_path("pioneer_ros2"), "config", "fleet.yaml")
    return rules_from_mapping(yaml.safe_load(path.read_text()))


def missed(rows: list[Row]) -> list[str]:
    return [row.what for row in rows if row.holds is False]


def test_every_stream_of_the_bench_crosses_the_door_by_its_default_rules_under_its_name() -> None:
    streams = [*fleet_streams(ROBOTS), scan_stream(), image_stream(), pose_stream()]
    robots = {f"pioneer{number}" for number in range(1, ROBOTS + 1)}
    found = exports(rules(), {stream.source for stream in streams}, robots)
    crossing = {(export.source, export.name) for export in found}
    assert {(stream.source, stream.target) for stream in streams} <= crossing


@pytest.mark.parametrize("stream", [*fleet_streams(1), scan_stream(), image_stream()], ids=str)
def test_every_message_of_the_stand_in_can_be_converted(stream) -> None:
    data = serialised_example(stream.source, stream.type_name)
    definition = get_message_class(stream.type_name)._full_text
    converter = MessageTypes().converter(stream.type_name, definition)
    assert converter.to_ros1(converter.to_cdr(data))[4:] == data[4:] or stream.source == "/clock"


def test_a_message_has_the_size_that_the_tables_name() -> None:
    scan = serialised_example(scan_stream().source, scan_stream().type_name)
    image = serialised_example(image_stream().source, image_stream().type_name)
    assert 4 * 180 < len(scan) < 4 * 180 + 100
    assert 1.05e6 < len(image) < 1.05e6 + 100


def test_only_the_door_has_goals_and_misses_them_when_it_is_slow() -> None:
    fast, slow = Carried(200.0, 1e-3, 2e-3, 20e-6), Carried(200.0, 1e-3, 2e-3, 90e-6)
    rows = carried_rows("scan", "CPU µs", 1e6, {DOOR: [fast], BRIDGE: [slow]})
    assert missed(rows) == []
    rows = carried_rows("scan", "CPU µs", 1e6, {DOOR: [slow], BRIDGE: [fast]})
    assert missed(rows) == [f"scan, {DOOR}: whole process"]
    rows = conversion_rows("scan", "CPU µs", 1e6, {DOOR: [90e-6], BRIDGE: [20e-6]}, 60.0)
    assert missed(rows) == [f"scan, {DOOR}: conversion alone"]


def test_idle_read_and_memory_have_goals_of_their_own() -> None:
    good, bad = FleetCost(0.01, 0.05, 0.07, 45.0), FleetCost(0.03, 0.09, 0.12, 60.0)
    assert missed(fleet_rows(5, {DOOR: [good], BRIDGE: [bad]})) == []
    assert len(missed(fleet_rows(5, {DOOR: [bad], BRIDGE: [good]}))) == 4


def test_latency_is_judged_above_that_of_ros_1_in_the_same_window() -> None:
    direct, through, late = (Received(50.0, each, 2 * each) for each in (5e-4, 1.2e-3, 1.6e-3))
    beside = {DOOR: [direct], BRIDGE: [direct]}
    rows = latency_rows([direct], [direct], {DOOR: [through], BRIDGE: [late]}, beside)
    assert missed(rows) == []
    rows = latency_rows([direct], [direct], {DOOR: [late], BRIDGE: [through]}, beside)
    (name,) = missed(rows)
    assert re.search("door: p50 above rospy", name)


def test_compare_takes_the_machine_s_speed_out_of_the_rows() -> None:
    rows = fleet_rows(5, {DOOR: [FleetCost(0.01, 0.05, 0.07, 45.0)], BRIDGE: []})
    rows += conversion_rows("scan", "CPU µs", 1e6, {DOOR: [1e-6], BRIDGE: [2e-6]}, 60.0)
    figures = figures_of({"rows": [row.as_dict() for row in rows]})
    scales = {figure.unit: figure.scale for figure in figures.values()}
    assert scales == {
        "% of a core": Scale.CPU_TIME,
        "CPU-s/s": Scale.CPU_TIME,
        "CPU µs": Scale.CPU_TIME,
        "MB": Scale.NONE,
    }
