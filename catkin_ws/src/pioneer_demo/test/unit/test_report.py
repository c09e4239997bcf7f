"""The numbers, table and picture that a demo writes."""

import dataclasses
import json
import math
import types

import numpy as np
import pytest
from PIL import Image

from pioneer_demo.observer.conversions import floor_from_grid
from pioneer_demo.observer.fleet import Fleet
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report.picture import draw_fleet
from pioneer_demo.report.report import Outcome, columns, report, reproducible, table, verdict_line
from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_harness.accounting import Usage


@pytest.fixture
def fleet():
    robot = RobotTrack("pioneer1")
    robot.assign([Leg(Pose(3.0, 1.0, math.pi / 2), np.array([[1.0, 1.0], [3.0, 1.0]]), 2.0)])
    robot.add_correction(Pose(0.0, 0.0))
    robot.add_plan([(1.0, 1.0), (3.0, 1.0)])
    for tick in range(21):
        robot.add_odometry(10.0 + tick, Pose(1.0 + 0.1 * tick, 1.02))
        robot.add_truth(10.0 + tick, Pose(1.0 + 0.1 * tick, 1.0))
    robot.add_queue(Queue(ClientState.IDLE, 1, 1, 0, ""))
    fleet = Fleet([robot], began=10.0)
    fleet.simulator.time = fleet.ended = 30.0
    return fleet


@pytest.fixture
def outcome():
    return Outcome(
        [], {"simulator ready": 5.0}, 12.5, 10.0, 30.0, {"amcl": Usage(3.0, 50_000_000, 1)}
    )


def test_the_numbers_say_what_happened_and_are_json(fleet, outcome):
    numbers = json.loads(json.dumps(report(fleet, outcome, {"seed": 1}), allow_nan=False))
    robot = numbers["robots"]["pioneer1"]
    assert robot["reached"] == 1
    assert robot["seconds"] == 20.0
    assert robot["path_length"] == pytest.approx(2.0)
    assert robot["localisation_error"]["mean"] == pytest.approx(0.02)
    assert robot["visits"][0]["heading_degrees"] == pytest.approx(90.0)
    assert numbers["drive"]["real_time_factor"] == 2.0
    assert numbers["drive"]["cpu_seconds_per_simulated_second"] == 1.5
    assert numbers["seconds_to_moving"] == 12.5


def test_messages_count_from_the_start_and_on_connections_that_were_made_again():
    fleet = Fleet([])
    for counters in ((10, 1000), (30, 3000)):
        fleet.traffic.add("base: to robot /clock", *counters)
    fleet.traffic.restart()
    for counters in ((35, 3500), (4, 400), (6, 600)):
        fleet.traffic.add("base: to robot /clock", *counters)
    fleet.traffic.add("base: from robot /tf", 1, 50)
    assert (fleet.traffic.messages, fleet.traffic.bytes) == (12, 1150)


def test_what_is_unknown_is_null_and_shown_as_a_dash(outcome):
    numbers = report(Fleet([RobotTrack("pioneer1")]), outcome, {})
    assert numbers["robots"]["pioneer1"]["localisation_error"]["mean"] is None
    assert "– m" in table(numbers)


def test_the_table_names_robots_costs_and_the_real_time_factor(fleet, outcome):
    text = table(report(fleet, outcome, {}))
    assert "pioneer1        1/1  20.0 s" in text
    assert "real-time factor 2.00" in text
    assert "amcl" in text


def test_what_the_machine_decides_is_apart_from_what_the_run_does(fleet, outcome):
    numbers = report(fleet, outcome, {"seed": 1, "ports": "hub 6380"})
    slower = report(
        fleet,
        dataclasses.replace(outcome, drive_wall=99.0, milestones={}),
        {"seed": 1, "ports": "other"},
    )
    (run, machine), (again, other) = reproducible(numbers), reproducible(slower)
    assert run == again
    assert machine != other
    assert machine["drive"] == numbers["drive"]


def test_the_verdict_is_one_line(fleet, outcome):
    assert (
        verdict_line(report(fleet, outcome, {}))
        == "Success: 1 robot, 1 waypoint reached, no collision"
    )
    failed = Outcome(["pioneer1 collided once"], {}, math.nan, 1.0, 1.0, {})
    assert verdict_line(report(fleet, failed, {})) == "Failed: pioneer1 collided once"


def test_a_success_that_allows_misses_and_collisions_tells_them(fleet, outcome):
    numbers = report(fleet, outcome, {})
    robot = numbers["robots"]["pioneer1"] | {"waypoints": 3, "collisions": 2}
    allowed = numbers | {"robots": {"pioneer1": robot}}
    assert verdict_line(allowed) == "Success: 1 robot, 1 of 3 waypoints reached, 2 collisions"


def test_columns_line_up():
    assert columns(("a", "bb"), [("xxx", "1")]) == "a    bb\nxxx   1"


def test_a_map_becomes_a_floor_and_is_drawn_with_the_fleet(tmp_path, fleet):
    cells = np.zeros((40, 60), np.int8)
    cells[-1, :], cells[:, -10:] = 100, -1
    corner = types.SimpleNamespace(position=types.SimpleNamespace(x=0.0, y=-1.0))
    info = types.SimpleNamespace(width=60, height=40, resolution=0.1, origin=corner)
    floor = floor_from_grid(types.SimpleNamespace(data=cells.ravel(), info=info))
    assert floor.occupied[-1, 5]
    assert floor.free[5, 5]
    assert not floor.free[5, -1]
    assert not floor.occupied[5, -1]
    assert floor.position(0, 0) == pytest.approx((0.05, -0.95))
    draw_fleet(floor, fleet, "one robot", tmp_path / "fleet.png")
    with Image.open(tmp_path / "fleet.png") as picture:
        assert picture.width > 400
        assert picture.width < 1.2 * picture.height, "the legend stands below, not beside the map"
