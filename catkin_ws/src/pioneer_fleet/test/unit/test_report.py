from pioneer_fleet.monitor.client import ClientState, Queue
from pioneer_fleet.monitor.monitor import deviation_from_covariance
from pioneer_fleet.monitor.report import Report, Stage, states_of


def queue(received: int = 0, reached: int = 0, aborted: int = 0, waiting: int = 0) -> Queue:
    return Queue(ClientState.IDLE, received, reached, aborted, "", waiting)


def robot(**known: object) -> Report:
    return Report("aadi1", "pioneer1", **known)


ACTIVE = {"pull clock": "active", "flip odom": "active"}


def test_a_computer_without_a_hub_is_starting_and_reports_it() -> None:
    assert robot().stage is Stage.STARTING
    assert robot(gateway="aadi1_gateway").lacks == "aadi1_gateway has not found the hub"


def test_a_rule_that_does_not_carry_is_named() -> None:
    report = robot(
        gateway="g", hub="h", rules={**ACTIVE, "pull map": "no publisher", "pull tf": "pending"}
    )
    assert report.stage is Stage.CONNECTED
    assert report.lacks == "pull map: no publisher (and 1 more)"


def test_a_rule_that_thins_messages_out_is_in_force() -> None:
    report = robot(gateway="g", hub="h", rules={**ACTIVE, "flip base_scan": "rate-limited"})
    assert report.stage is Stage.LINKED
    assert report.as_json(0.0)["active"] == 3
    assert report.lacks == "no odometry received"


def test_a_tool_that_has_ended_leaves_no_rule_to_wait_for() -> None:
    odom = {
        "action": "flip",
        "gateway": "a",
        "type": "publisher",
        "name": "odom",
        "node": "",
        "state": "active",
    }
    page = {**odom, "name": "goal", "node": "/fleet_page.*"}
    assert states_of([odom, page]) == {
        "flip a publisher odom": "active",
        "flip a publisher goal /fleet_page.*": "active",
    }
    assert states_of([odom, {**page, "state": "no such topic"}]) == {
        "flip a publisher odom": "active"
    }
    assert states_of([{**odom, "state": "no such topic"}]) == {
        "flip a publisher odom": "no such topic"
    }


def test_a_robot_with_rules_and_sensors_but_no_pose_is_not_ready() -> None:
    report = robot(gateway="g", hub="h", rules=ACTIVE, odom_at=1.0, scan_at=1.0, queue=queue())
    assert report.stage is Stage.SENSING
    assert report.lacks == "amcl has not localised the robot"


def test_a_ready_robot_moves_when_it_turns_or_drives() -> None:
    report = robot(
        gateway="g",
        hub="h",
        rules=ACTIVE,
        odom_at=1.0,
        scan_at=1.0,
        queue=queue(),
        pose=(0.0, 0.0, 0.0),
    )
    assert report.stage is Stage.READY
    assert not report.lacks
    report.angular = -0.4
    assert report.stage is Stage.MOVING


def test_a_robot_at_its_goal_has_moved_and_one_that_waits_or_failed_has_not() -> None:
    ready = {
        "gateway": "g",
        "hub": "h",
        "rules": ACTIVE,
        "odom_at": 1.0,
        "scan_at": 1.0,
        "queue": queue(),
        "pose": (0.0,) * 3,
    }
    assert robot(**ready | {"queue": queue(3, 2, 1)}).has_come(Stage.MOVING)
    assert not robot(**ready).has_come(Stage.MOVING)
    assert not robot(**ready | {"queue": queue(3, 1, 0, 2)}).has_come(Stage.MOVING)
    assert not robot(**ready | {"queue": queue(1, 0, 1)}).has_come(Stage.MOVING)
    assert not robot(queue=queue(1, 1)).has_come(Stage.MOVING), "its gateway is gone meanwhile"
    assert robot(**ready).has_come(Stage.READY)


def test_the_base_station_needs_a_simulator_with_robots() -> None:
    base = Report(
        "aadiworkstation", gateway="Hub_Gateway", hub="h", rules=ACTIVE, real_time_factor=1.0
    )
    assert base.lacks == "the simulator does not run yet"
    base.models = ("pioneer1",)
    assert base.stage is Stage.MOVING


def test_ages_are_reported_in_place_of_times() -> None:
    assert robot(odom_at=9.75).as_json(10.0)["odom_age"] == 0.25
    assert robot().as_json(10.0)["odom_age"] is None


def test_the_deviation_is_the_larger_of_the_two() -> None:
    covariance = [0.0] * 36
    covariance[0], covariance[7] = 0.01, 0.04
    assert deviation_from_covariance(covariance) == 0.2


def test_a_robot_has_arrived_when_all_it_was_sent_to_is_dealt_with() -> None:
    assert robot().has_arrived(0)
    assert not robot(queue=queue(1)).has_arrived(2)
    assert not robot(queue=queue(2, waiting=1)).has_arrived(2)
    assert robot(queue=queue(2, 1, 1)).has_arrived(2)


def test_the_longest_gap_is_of_simulated_time_and_a_new_world_is_none() -> None:
    report = robot()
    for now, stamp in ((0.0, 100.0), (9.0, 100.1), (9.1, 100.6), (9.2, 3.0), (9.3, 3.1)):
        report.add_odom(now, stamp)
        report.add_scan(now, stamp)
    line = report.as_json(10.0)
    assert (line["odom_gap"], line["scan_gap"], line["odom_age"]) == (0.5, 0.5, 0.7)
