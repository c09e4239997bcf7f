"""Waypoints on disk, for a client that replaces one that has exited."""

from pathlib import Path

import pytest

from simple_navigation_goals.queue import Outcome, WaypointQueue
from simple_navigation_goals.waypoint import Waypoint
from simple_navigation_goals.waypoint_file import Kept, QueueFile, QueueFileError

PLACES = [Waypoint(1.0, -2.5, 0.5, "map"), Waypoint(3.0, 0.0, 0.0, "map", 2.0)]


def test_what_is_left_of_a_queue_is_read_by_the_next_client(tmp_path: Path) -> None:
    queue, file = WaypointQueue(), QueueFile(str(tmp_path / "waypoints.json"))
    queue.server_found()
    for place in PLACES:
        queue.add(place)
    assert queue.remaining == PLACES
    queue.sent(queue.due())
    file.write(queue.remaining)
    kept = QueueFile(str(tmp_path / "waypoints.json")).read()
    assert kept == Kept(tuple(PLACES)), "the one under way, too"
    queue.finished(Outcome.REACHED)
    file.write(queue.remaining)
    assert QueueFile(str(tmp_path / "waypoints.json")).read() == Kept(tuple(PLACES[1:]))
    assert [one.name for one in tmp_path.iterdir()] == ["waypoints.json"]


def test_no_path_and_no_file_are_no_waypoints(tmp_path: Path) -> None:
    QueueFile("").write(PLACES)
    assert QueueFile("").read() == QueueFile(str(tmp_path / "none")).read() == Kept()


def test_a_robot_that_was_stopped_stays_stopped_when_its_client_is_replaced(tmp_path: Path) -> None:
    path = str(tmp_path / "waypoints.json")
    queue, file = WaypointQueue(), QueueFile(path)
    queue.server_found()
    for place in PLACES:
        queue.add(place)
    queue.sent(queue.due())
    queue.finished(Outcome.CANCELLED)
    file.write(queue.remaining, queue.held)

    kept = QueueFile(path).read()
    assert kept == Kept(tuple(PLACES[1:]), held=True)
    following = WaypointQueue()
    following.server_found()
    for place in kept.waypoints:
        following.add(place)
    following.hold()
    assert following.held
    assert following.due() is None
    following.add(PLACES[0])
    assert following.due() == PLACES[1]


def test_the_list_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    path = tmp_path / "waypoints.json"
    path.write_text('[{"x": 1.0, "y": -2.5, "yaw": 0.5, "frame": "map"}]')
    assert QueueFile(str(path)).read() == Kept((PLACES[0],))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "3",
        "[1]",
        "{}",
        '{"held": false, "waypoints": 3}',
        '[{"x": 1}]',
        '[{"x": "a", "y": 0, "yaw": 0, "frame": "map"}]',
    ],
)
def test_a_file_of_something_else_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "waypoints.json"
    path.write_text(text)
    with pytest.raises(QueueFileError, match=r"waypoints.json holds no waypoints"):
        QueueFile(str(path)).read()
