from pioneer_fleet.core.report import Report, Stage, deviation_from_covariance


def robot(**known: object) -> Report:
    return Report("aadi1", "pioneer1", **known)


ACTIVE = {"pull clock": "active", "flip odom": "active"}


def test_a_computer_without_a_hub_is_starting_and_says_so() -> None:
    assert robot().stage is Stage.STARTING
    assert robot(gateway="aadi1_gateway").lacks == "aadi1_gateway has not found the hub"


def test_a_rule_that_does_not_carry_is_named() -> None:
    report = robot(gateway="g", hub="h", rules={**ACTIVE, "pull map": "no publisher", "pull tf": "pending"})
    assert report.stage is Stage.CONNECTED
    assert report.lacks == "pull map: no publisher (and 1 more)"


def test_a_rule_that_thins_messages_out_is_in_force() -> None:
    report = robot(gateway="g", hub="h", rules={**ACTIVE, "flip base_scan": "rate-limited"})
    assert report.stage is Stage.LINKED
    assert report.as_json(0.0)["active"] == 3
    assert report.lacks == "no odometry has come"


def test_a_robot_with_rules_and_sensors_but_no_pose_is_not_ready() -> None:
    report = robot(gateway="g", hub="h", rules=ACTIVE, odom_at=1.0, scan_at=1.0, waypoint="")
    assert report.stage is Stage.SENSING
    assert report.lacks == "amcl has not localised the robot"


def test_a_ready_robot_moves_when_it_turns_or_drives() -> None:
    report = robot(gateway="g", hub="h", rules=ACTIVE, odom_at=1.0, scan_at=1.0, waypoint="", pose=(0.0, 0.0, 0.0))
    assert report.stage is Stage.READY
    assert not report.lacks
    report.angular = -0.4
    assert report.stage is Stage.MOVING


def test_a_robot_that_stands_where_it_was_sent_has_moved_and_one_that_only_waits_or_failed_has_not() -> None:
    ready = {
        "gateway": "g",
        "hub": "h",
        "rules": ACTIVE,
        "odom_at": 1.0,
        "scan_at": 1.0,
        "waypoint": "",
        "pose": (0.0,) * 3,
    }
    assert robot(**ready, received=3, reached=2, aborted=1).has_come(Stage.MOVING)
    assert not robot(**ready).has_come(Stage.MOVING)
    assert not robot(**ready, received=3, reached=1, waiting=2).has_come(Stage.MOVING)
    assert not robot(**ready, received=1, aborted=1).has_come(Stage.MOVING)
    assert not robot(received=1, reached=1).has_come(Stage.MOVING), "its gateway is gone meanwhile"
    assert robot(**ready).has_come(Stage.READY)


def test_the_base_station_needs_a_simulator_with_robots() -> None:
    base = Report("aadiworkstation", gateway="Hub_Gateway", hub="h", rules=ACTIVE, real_time_factor=1.0)
    assert base.lacks == "the simulator does not run yet"
    base.models = ("pioneer1",)
    assert base.stage is Stage.MOVING


def test_ages_are_told_in_place_of_times() -> None:
    assert robot(odom_at=9.75).as_json(10.0)["odom_age"] == 0.25
    assert robot().as_json(10.0)["odom_age"] is None


def test_the_deviation_is_the_larger_of_the_two() -> None:
    covariance = [0.0] * 36
    covariance[0], covariance[7] = 0.01, 0.04
    assert deviation_from_covariance(covariance) == 0.2


def test_a_robot_has_arrived_when_all_it_was_sent_to_is_dealt_with() -> None:
    assert robot().has_arrived(0)
    assert not robot(received=1).has_arrived(2)
    assert not robot(received=2, waiting=1).has_arrived(2)
    assert robot(received=2, reached=1, aborted=1).has_arrived(2)


def test_the_longest_gap_is_of_simulated_time_and_a_new_world_is_none() -> None:
    report = robot()
    for now, stamp in ((0.0, 100.0), (9.0, 100.1), (9.1, 100.6), (9.2, 3.0), (9.3, 3.1)):
        report.hear_odom(now, stamp)
        report.hear_scan(now, stamp)
    line = report.as_json(10.0)
    assert (line["odom_gap"], line["scan_gap"], line["odom_age"]) == (0.5, 0.5, 0.7)
