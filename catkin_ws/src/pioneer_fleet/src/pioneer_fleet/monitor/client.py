"""Reports of the waypoint client."""

import dataclasses
import enum


class ClientState(enum.IntEnum):
    """States of the waypoint client, numbered as in ``simple_navigation_goals/WaypointQueue``."""

    IDLE = 0
    WAITING_FOR_MOVE_BASE = 1
    DRIVING = 2
    RESTING = 3
    UNKNOWN = 255  #: a number that this version does not know


@dataclasses.dataclass(frozen=True)
class Queue:
    """A report of the waypoint client."""

    state: ClientState  #: its current state
    #: received, reached, aborted: waypoints so far
    received: int
    reached: int
    aborted: int
    text: str  #: its last status text
    waiting: int = 0  #: waypoints not reached yet, including the current one
