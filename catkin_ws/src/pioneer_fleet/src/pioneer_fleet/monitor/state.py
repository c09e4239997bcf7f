"""What a robot is doing, and why it does not get on: one list of states for the terminal, the page and every report."""

import enum
from collections.abc import Mapping
from typing import NamedTuple

from pioneer_fleet.monitor.client import ClientState, Queue

MOVE_BASE, RIGHT_OF_WAY = "move_base", "traffic"
ACTIONS = (RIGHT_OF_WAY, MOVE_BASE)
"""Actions that can take a robot's waypoints; the first sends the robot through the second. Their servers publish
``ACTION/state`` (``nav_bundle/NavigationState``)."""


class Activity(enum.IntEnum):
    """What a robot is doing, numbered as in ``nav_bundle/NavigationState``."""

    STARTING = 0
    IDLE = 1
    DRIVING = 2
    RECOVERING = 3
    BLOCKED = 4
    WAITING = 5
    LOST = 6
    HELD = 7
    MANUAL = 8
    FAILED = 9
    OFFLINE = 10


_TROUBLES = frozenset(
    {
        Activity.RECOVERING,
        Activity.BLOCKED,
        Activity.WAITING,
        Activity.LOST,
        Activity.HELD,
        Activity.FAILED,
        Activity.OFFLINE,
    }
)
"""What a robot does that does not get on."""


class State(NamedTuple):
    """What a robot is doing."""

    activity: Activity
    text: str  #: the same for people, with the reason: "blocked: the goal is occupied by pioneer3"

    @property
    def trouble(self) -> str:
        """Why the robot does not get on; empty if it does, or has nothing to do."""
        return self.text if self.activity in _TROUBLES else ""

    def as_json(self) -> dict[str, str]:
        """Returns its part of a report for ``json.dumps``."""
        return {
            "activity": self.activity.name.lower(),
            "state": self.text,
            "trouble": self.trouble,
        }


_OF_CLIENT = {
    ClientState.IDLE: State(Activity.IDLE, "idle"),
    ClientState.DRIVING: State(Activity.DRIVING, "driving"),
    ClientState.RESTING: State(Activity.IDLE, "resting"),
    ClientState.UNKNOWN: State(Activity.IDLE, "in an unknown state"),
}


def state_of(queue: Queue | None, said: Mapping[str, State]) -> State:
    """Returns the state of a robot that is localised.

    Args:
        queue: the newest report of its waypoint client; None before the first.
        said: the newest states that the servers of its actions have reported, by action. What the right of way says
            comes before what move_base says.
    """
    by_rank = [said[action] for action in ACTIONS if action in said]
    for state in by_rank:
        if state.activity is Activity.STARTING and state.text != "starting":
            return state
    if queue is not None and queue.state is ClientState.WAITING_FOR_MOVE_BASE:
        # What that server said last is out of date.
        server = RIGHT_OF_WAY if RIGHT_OF_WAY in said else MOVE_BASE
        return State(Activity.STARTING, f"waiting for {server}")
    for state in by_rank:
        if state.trouble or state.activity is Activity.MANUAL:
            return state
    if queue is None:
        return State(Activity.STARTING, "waiting for the waypoint client")
    return _OF_CLIENT[queue.state]
