"""Shows a replay in the browser: the dashboard on the replay's master, with a slider."""
# ruff: noqa: T201 - a command talks to people on standard output

import os
import re
import secrets
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rospy
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import Empty

from pioneer_fleet.recording.player import Pace, Replay
from pioneer_fleet.recording.recording import Message, RecordingError, contents, messages_since
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_node.adapters.end_request import EndRequest

_PORT = 8090
_TELL = 0.5
"""Interval between two messages on /replay/position [s]."""
_SECOND = 1e9


class ReplayPage:
    """Serves a recording on the dashboard and executes the page's replay commands.

    Publishes: /replay/position (std_msgs/Float64MultiArray): position and length of the recording [s].
    Subscribes: /replay/seek (std_msgs/Float64): time to continue at [s].
    Services: /gazebo/pause_physics, /gazebo/unpause_physics.
    Parameters: sets /robot_names.

    Raises:
        RecordingError: the recording contains no robot.
    """

    def __init__(self, path: Path, pace: Pace) -> None:
        self._path, self._pace = path, pace
        self._begin, self._end, topics = contents(path)
        robots = {
            found[1] for topic in topics if (found := re.fullmatch(r"/base/([^/]+)/odom", topic))
        }
        if not robots:
            raise RecordingError(f"{path} has no robot's odometry of the base station")
        rospy.set_param("/robot_names", sorted(robots, key=lambda name: (len(name), name)))
        self._position = rospy.Publisher(
            "/replay/position", Float64MultiArray, queue_size=1, latch=True
        )
        rospy.Subscriber("/replay/seek", Float64, self._on_seek)
        rospy.Service("/gazebo/pause_physics", Empty, lambda _: self._pause(True))
        rospy.Service("/gazebo/unpause_physics", Empty, lambda _: self._pause(False))
        self._ports, self._group = PortReservation(), ProcessGroup()

    def __enter__(self) -> "ReplayPage":
        port, token = self._ports.take(_PORT), secrets.token_urlsafe(16)
        environment = {**os.environ, "PIONEER_WEB_TOKEN": token}
        self._group.start(
            "fleet page", ["rosrun", "pioneer_web", "fleet_page", f"_port:={port}"], environment
        )
        print(f"Fleet page, once it is up: http://127.0.0.1:{port}/#{token}", flush=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._group.stop()
        self._ports.release()

    def play(self, replay: Replay, end: EndRequest) -> None:
        """Plays until ``end``, once a page is open. Each move of the slider restarts it from there."""
        telling = threading.Thread(target=self._tell, args=(end,), name="position", daemon=True)
        telling.start()
        at = self._begin
        while not self._position.get_num_connections() and not end.wait(_TELL):
            pass
        while not end.is_set():
            replay.play(_of_the_base(messages_since(self._path, at)), at)
            while self._pace.jump is None and not end.wait(_TELL):
                pass
            at = self._pace.jump if self._pace.jump is not None else at

    def _tell(self, end: EndRequest) -> None:
        while not end.wait(_TELL):
            at, length = (
                max(0, time - self._begin) / _SECOND for time in (self._pace.at, self._end)
            )
            self._position.publish(Float64MultiArray(data=[at, length]))

    def _on_seek(self, message: Any) -> None:
        self._pace.jump = max(
            self._begin, min(self._end, self._begin + round(_SECOND * message.data))
        )

    def _pause(self, paused: bool) -> dict[str, Any]:
        self._pace.paused = paused
        return {}


def _of_the_base(messages: Iterator[Message]) -> Iterator[Message]:
    """Yields the messages, but of the gateways, whose topics all have the same names, only the base station's."""
    return (
        one for one in messages if one.topic.startswith("/base/") or "/gateway/" not in one.topic
    )
