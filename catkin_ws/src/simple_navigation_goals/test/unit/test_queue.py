"""The queue sends one waypoint after the other, and handles failures as configured."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pioneer_node.core.parameter import ParameterError
from simple_navigation_goals.patrol import Patrol
from simple_navigation_goals.queue import ABORT_POLICIES, Outcome, Phase, QueueConfig, WaypointQueue
from simple_navigation_goals.waypoint import Waypoint


def waypoint(x: float) -> Waypoint:
    return Waypoint(x, 0.0, 0.0, "map")


def driving(count: int = 3, **config: object) -> WaypointQueue:
    """Returns a queue of ``count`` waypoints with the first under way."""
    queue = WaypointQueue(QueueConfig(**config))  # type: ignore[arg-type]
    queue.server_found()
    for x in range(count):
        queue.add(waypoint(x))
    send(queue)
    queue.take_events()
    return queue


def send(queue: WaypointQueue) -> float | None:
    due = queue.due()
    if due is not None:
        queue.sent(due)
    return None if due is None else due.x


def test_a_queue_without_waypoints_is_idle() -> None:
    queue = WaypointQueue()
    queue.server_found()
    assert queue.phase is Phase.IDLE
    assert queue.due() is None


def test_waypoints_wait_for_move_base_and_the_first_of_them_reports_it_once() -> None:
    queue = WaypointQueue()
    queue.add(waypoint(0.0))
    queue.add(waypoint(1.0))
    assert queue.phase is Phase.WAITING_FOR_MOVE_BASE
    assert queue.due() is None
    assert [event.text for event in queue.take_events()].count("waiting for move_base") == 1


def test_waypoints_are_sent_in_the_order_they_came_one_at_a_time() -> None:
    queue = driving(3)
    assert queue.due() is None
    for x in (1.0, 2.0):
        queue.finished(Outcome.REACHED)
        assert send(queue) == x
    queue.finished(Outcome.REACHED)
    assert (queue.phase, queue.reached, queue.aborted, queue.current) == (Phase.IDLE, 3, 0, None)


def test_a_reached_waypoint_is_said_with_its_number_and_place() -> None:
    queue = driving(2)
    queue.finished(Outcome.REACHED)
    assert queue.take_events() == [
        ("reached waypoint 1 (0.00, 0.00, 0 deg) in map, 1 waiting", False)
    ]


def test_skip_continues_with_the_next() -> None:
    queue = driving(2, on_abort="skip")
    queue.finished(Outcome.ABORTED, "no plan")
    assert send(queue) == 1.0
    assert queue.aborted == 1


def test_retry_sends_again_as_often_as_told_and_then_skips() -> None:
    queue = driving(2, on_abort="retry", retries=2)
    for _ in range(2):
        queue.finished(Outcome.ABORTED)
        assert (send(queue), queue.aborted) == (0.0, 0)
    queue.finished(Outcome.ABORTED)
    assert (send(queue), queue.aborted) == (1.0, 1)


def test_each_waypoint_has_its_own_retries() -> None:
    queue = driving(2, on_abort="retry", retries=1)
    for _ in range(2):
        queue.finished(Outcome.ABORTED)
        send(queue)
    queue.finished(Outcome.ABORTED)
    assert send(queue) == 1.0


def test_stop_holds_the_rest_until_a_new_waypoint_comes() -> None:
    queue = driving(2, on_abort="stop")
    queue.finished(Outcome.ABORTED)
    assert (queue.phase, queue.due(), len(queue.waiting)) == (Phase.IDLE, None, 1)
    queue.add(waypoint(9.0))
    assert send(queue) == 1.0


def test_clear_on_abort_drops_the_rest() -> None:
    queue = driving(3, on_abort="clear")
    queue.finished(Outcome.ABORTED)
    assert (queue.phase, len(queue.waiting), queue.aborted) == (Phase.IDLE, 0, 1)


@pytest.mark.parametrize("policy", ABORT_POLICIES)
def test_a_goal_that_somebody_else_cancelled_holds_the_rest_under_every_policy(policy: str) -> None:
    queue = driving(2, on_abort=policy)
    queue.finished(Outcome.CANCELLED)
    assert (queue.phase, queue.due(), len(queue.waiting), queue.aborted) == (Phase.IDLE, None, 1, 0)


def test_clearing_tells_whether_a_goal_must_be_cancelled() -> None:
    queue = driving(3)
    assert queue.clear() is True
    assert (queue.current, len(queue.waiting), queue.phase) == (None, 0, Phase.IDLE)
    assert queue.clear() is False


def test_a_move_base_that_is_gone_gets_its_waypoint_again_when_it_is_back() -> None:
    queue = driving(2)
    queue.server_lost()
    assert (queue.phase, queue.due()) == (Phase.WAITING_FOR_MOVE_BASE, None)
    queue.server_found()
    assert send(queue) == 0.0


def test_a_goal_that_move_base_lost_is_sent_again() -> None:
    queue = driving(2)
    queue.finished(Outcome.LOST)
    assert send(queue) == 0.0


def test_a_waypoint_sent_in_another_frame_is_sent_again_in_that_frame() -> None:
    queue = WaypointQueue()
    queue.server_found()
    queue.add(Waypoint(1.0, 0.0, 0.0, "pioneer1/base_link"))
    assert queue.due() is not None
    queue.sent(Waypoint(5.0, 5.0, 0.0, "map"))
    queue.finished(Outcome.LOST)
    assert queue.due() == Waypoint(5.0, 5.0, 0.0, "map")


def test_an_outcome_without_a_goal_under_way_changes_nothing() -> None:
    queue = driving(1)
    queue.clear()
    queue.finished(Outcome.REACHED)
    assert queue.reached == 0


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(ParameterError, match="on_abort must be one of skip"):
        QueueConfig(on_abort="panic")
    with pytest.raises(ParameterError, match="retries"):
        QueueConfig(retries=-1)


STEPS = st.lists(
    st.one_of(
        st.just("add"),
        st.just("clear"),
        st.just("found"),
        st.just("lost"),
        st.just("send"),
        st.sampled_from(list(Outcome)),
    ),
    max_size=60,
)


@given(STEPS, st.sampled_from(ABORT_POLICIES))
def test_no_waypoint_is_counted_twice_and_none_is_sent_without_move_base(
    steps: list[object], policy: str
) -> None:
    queue = WaypointQueue(QueueConfig(on_abort=policy, retries=1))
    server = False
    for step in steps:
        match step:
            case "add":
                queue.add(waypoint(queue.received))
            case "clear":
                queue.clear()
            case "found":
                queue.server_found()
                server = True
            case "lost":
                queue.server_lost()
                server = False
            case "send":
                assert queue.due() is None or server
                send(queue)
            case Outcome():
                queue.finished(step)
        held = len(queue.waiting) + (queue.current is not None)
        assert queue.reached + queue.aborted + held <= queue.received
        assert (queue.phase is Phase.DRIVING) <= (queue.current is not None and server)


def patrolling(rounds: int, **config: object) -> WaypointQueue:
    """Returns a queue on a patrol: to x = 0 (under way), then to x = 1, where the robot waits for 5 s."""
    queue = WaypointQueue(QueueConfig(**config))  # type: ignore[arg-type]
    queue.server_found()
    queue.patrol(Patrol((waypoint(0.0), Waypoint(1.0, 0.0, 0.0, "map", 5.0)), rounds))
    send(queue)
    return queue


def test_a_patrol_goes_round_as_often_as_it_says_and_rests_where_it_says() -> None:
    queue = patrolling(2)
    for _ in range(2):
        queue.finished(Outcome.REACHED)
        assert send(queue) == 1.0
        queue.finished(Outcome.REACHED)
        assert (queue.phase, queue.rest, queue.due()) == (Phase.RESTING, 5.0, None)
        queue.rested()
        send(queue)
    assert (queue.phase, queue.reached, queue.received) == (Phase.IDLE, 4, 4)
    assert queue.text == "the patrol is done: 2 rounds of 2 waypoints"


def test_an_endless_patrol_ends_by_clear() -> None:
    queue = patrolling(0)
    for _ in range(50):
        queue.finished(Outcome.REACHED)
        queue.rested()
        assert send(queue) is not None
    assert queue.clear()
    assert (queue.phase, queue.due()) == (Phase.IDLE, None)


def test_a_patrol_that_reaches_nothing_in_a_round_ends() -> None:
    queue = patrolling(0)
    for _ in range(2):
        queue.finished(Outcome.ABORTED)
        send(queue)
    assert queue.phase is Phase.IDLE
    assert queue.text == "the patrol ends: no waypoint of round 1 was reached"


def test_a_patrol_continues_past_a_waypoint_that_cannot_be_reached() -> None:
    queue = patrolling(0)
    queue.finished(Outcome.ABORTED)
    assert send(queue) == 1.0
    queue.finished(Outcome.REACHED)
    queue.rested()
    assert send(queue) == 0.0


@pytest.mark.parametrize(("policy", "phase"), [("stop", Phase.IDLE), ("clear", Phase.IDLE)])
def test_what_is_to_follow_an_abort_holds_for_patrols(policy: str, phase: Phase) -> None:
    queue = patrolling(0, on_abort=policy)
    queue.finished(Outcome.ABORTED)
    assert (queue.phase, send(queue)) == (phase, None)
    queue.add(waypoint(9.0))
    assert send(queue) == (1.0 if policy == "stop" else 9.0)


def test_who_cancels_the_last_goal_of_a_round_is_not_driven_against() -> None:
    queue = patrolling(0)
    queue.finished(Outcome.REACHED)
    send(queue)
    queue.finished(Outcome.CANCELLED)
    assert send(queue) is None
    queue.add(waypoint(9.0))
    assert send(queue) == 9.0
    queue.finished(Outcome.REACHED)
    assert send(queue) == 0.0


def test_the_texts_name_the_action_that_takes_the_waypoints():
    """With right of way, "move_base disconnected" was said of the coordinator."""
    queue = WaypointQueue(action="traffic")
    queue.server_found()
    queue.server_lost()
    assert [event.text for event in queue.take_events()] == [
        "traffic is running",
        "traffic disconnected",
    ]
