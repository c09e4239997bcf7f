"""Which robots an emergency stop from ROS 2 holds."""

import pytest

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

from pioneer_ros2.estop import ALL, HeldRobots


def test_a_robot_is_free_only_when_every_topic_that_held_it_releases_it() -> None:
    held = HeldRobots()
    assert held.put(ALL, True)
    assert held.put("p1", True)
    assert held.holds("p1")
    assert held.holds("p2")
    held.put(ALL, False)
    assert held.holds("p1")
    assert not held.holds("p2")
    held.put("p1", False)
    assert not held.holds("p1")


def test_a_stop_that_is_repeated_changes_nothing() -> None:
    held = HeldRobots()
    assert held.put("p1", True)
    assert not held.put("p1", True)
    assert held.put("p1", False)
    assert not held.put("p1", False)


def test_what_the_node_before_held_is_held_from_the_start() -> None:
    held = HeldRobots(["p2", ALL])
    assert held.entries == [ALL, "p2"]
    assert held.holds("p9")
