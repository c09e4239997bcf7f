"""The targets of a stop are found in the master's state, whatever the robots are called."""

from pioneer_control.core.target import Targets, any_live, targets_from_graph

PUBLISHERS = {
    "/pioneer1/pioneer/cmd_vel": ["/pioneer1/pioneer_ros"],
    "/pioneer1/map_goal_client/queue": ["/pioneer1/map_goal_client"],
    "/pioneer/cmd_vel_raw": ["/joystick"],
    "/estop/pioneer/cmd_vel": ["/estop"],
}
SUBSCRIBERS = {
    "/pioneer2/pioneer/cmd_vel": ["/gazebo"],
    "/pioneer/cmd_vel": ["/gazebo"],
    "/pioneer1/move_base/cancel": ["/pioneer1/move_base"],
    "/pioneer3/move_base/cancel": ["/estop"],
    "/elevator/cancel": ["/elevator"],
}
SERVICES = {
    "/pioneer1/map_goal_client/clear": ["/pioneer1/map_goal_client"],
    "/display/clear": ["/display"],
}


def targets() -> Targets:
    return targets_from_graph(PUBLISHERS, SUBSCRIBERS, SERVICES, own="/estop")


def test_velocity_topics_are_found_with_and_without_namespace() -> None:
    assert targets().commands == {
        "/pioneer1/pioneer/cmd_vel",
        "/pioneer2/pioneer/cmd_vel",
        "/pioneer/cmd_vel",
    }


def test_only_a_move_base_that_somebody_serves_counts() -> None:
    assert targets().actions == {"/pioneer1/move_base"}


def test_a_service_called_clear_counts_only_beside_a_queue() -> None:
    assert targets().clears == {"/pioneer1/map_goal_client/clear"}


def test_naming_robots_leaves_out_the_others() -> None:
    assert targets().of(["pioneer2"]) == Targets(commands=frozenset({"/pioneer2/pioneer/cmd_vel"}))
    assert targets().of(["pioneer"]).commands == {"/pioneer/cmd_vel"}
    assert targets().of([]) == targets()


def test_a_goal_lives_until_it_has_ended() -> None:
    assert [number for number in range(10) if any_live([number])] == [0, 1, 6, 7]
    assert not any_live([])
