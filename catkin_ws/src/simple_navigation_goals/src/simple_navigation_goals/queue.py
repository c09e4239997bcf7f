"""The waypoint queue as a state machine: what to send to move_base, and what to do when a goal fails.

It uses neither clock nor ROS. Its owner reports what happened (``add``, ``clear``, ``finished``, ``server_found``,
``server_lost``, ``rested``), gets the next waypoint from ``due``, and reports it as ``sent``. Every change adds one
line of text, returned by ``take_events``.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import NamedTuple

from pioneer_node.core.parameter import ParameterError
from simple_navigation_goals.patrol import Patrol
from simple_navigation_goals.waypoint import Waypoint


class Phase(IntEnum):
    """State of the queue; the values are those of the message WaypointQueue."""

    IDLE = 0
    WAITING_FOR_MOVE_BASE = 1
    DRIVING = 2
    RESTING = 3


class Outcome(Enum):
    """How a goal of move_base ended."""

    REACHED = "reached"
    ABORTED = "aborted"
    """move_base gave up, or rejected the goal."""
    CANCELLED = "cancelled"
    """Another client cancelled the goal or sent another one."""
    LOST = "lost"
    """move_base no longer knows the goal: it was restarted."""


ABORT_POLICIES = ("skip", "retry", "stop", "clear")
"""Values of ``on_abort``."""


@dataclass(frozen=True)
class QueueConfig:
    """Policy for waypoints that move_base aborts.

    ``on_abort``: ``skip`` continues with the next one; ``retry`` sends it again up to ``retries`` times, then skips it;
    ``stop`` holds the rest until a new waypoint arrives; ``clear`` drops the rest.

    Raises:
        ParameterError: an unknown policy, or a negative number of retries.
    """

    on_abort: str = "skip"
    retries: int = 2

    def __post_init__(self) -> None:
        if self.on_abort not in ABORT_POLICIES:
            raise ParameterError(
                f"parameter ~on_abort must be one of {', '.join(ABORT_POLICIES)}, not {self.on_abort!r}"
            )
        if self.retries < 0:
            raise ParameterError(f"parameter ~retries must not be negative, not {self.retries}")


class Event(NamedTuple):
    """One line about what happened, and whether it deserves a warning."""

    text: str
    trouble: bool = False


class WaypointQueue:
    """Waypoints in order of arrival; the first is the current one. Not thread-safe.

    Args:
        config: policy for waypoints that are aborted.
        action: name of the action that takes the waypoints, for people.
    """

    def __init__(self, config: QueueConfig | None = None, action: str = "move_base") -> None:
        self.config = config or QueueConfig()
        self._action = action
        #: aborted: number of waypoints given up after all retries, without those cleared or cancelled by others
        #: reached: number of waypoints that move_base reported as reached
        #: received: number of waypoints accepted since the start
        self.received = self.reached = self.aborted = 0
        self.current: Waypoint | None = (
            None  #: the waypoint sent or to be sent next; None if there is none
        )
        self.waiting: deque[Waypoint] = deque()  #: the waypoints after it
        self.text = ""  #: the latest event
        self._number = 0  # number of the current waypoint, in order of arrival
        self._retries_left = 0
        self.rest = 0.0  #: how long the robot has to stand before it continues [s]; 0 if not at all
        self._patrol: Patrol | None = None
        self._round = self._reached_before = 0
        self._held = self._under_way = self._server = False
        self._events: list[Event] = []

    @property
    def phase(self) -> Phase:
        """State of the queue."""
        if self._under_way:
            return Phase.DRIVING
        if self.rest > 0.0:
            return Phase.RESTING
        if self._wants_to_send():
            return Phase.WAITING_FOR_MOVE_BASE
        return Phase.IDLE

    @property
    def remaining(self) -> list[Waypoint]:
        """The current waypoint and those after it."""
        return [*([self.current] if self.current else []), *self.waiting]

    def add(self, waypoint: Waypoint) -> None:
        """Appends a waypoint; a held queue resumes."""
        self._append(waypoint)
        self._held = False
        self._say(f"waypoint {self.received} {waypoint} received, {len(self.waiting)} waiting")
        if not self._server and len(self.waiting) == 1 and self.current is None:
            self._say(f"waiting for {self._action}")

    @property
    def held(self) -> bool:
        """Whether the remaining waypoints wait for a new one, because of a stop or of `on_abort: stop`."""
        return self._held

    def hold(self) -> None:
        """Lets the waypoints wait for a new one, as those of a client that was stopped before it ended."""
        self._held = bool(self.waiting or self._patrol)
        if self._held:
            self._say(f"{len(self.waiting)} waypoints held until a new waypoint comes")

    def patrol(self, patrol: Patrol) -> bool:
        """Clears the queue and starts a patrol; returns the result of ``clear``."""
        was_under_way = self.clear()
        self._patrol, self._round = patrol, 0
        self._go_round()
        return was_under_way

    def rested(self) -> None:
        """Records that the robot has stood for ``rest`` seconds."""
        self.rest = 0.0
        self._go_round()

    def clear(self) -> bool:
        """Drops all waypoints and the patrol; returns whether a goal is active, which the owner must then cancel."""
        count = len(self.remaining)
        was_under_way = self._under_way
        self._drop_current()
        self._drop_waiting()
        self._patrol, self.rest = None, 0.0
        if count:
            self._say(f"{count} waypoints cleared")
        return was_under_way

    def due(self) -> Waypoint | None:
        """Returns the waypoint to send to move_base now; None if there is none or move_base is not connected."""
        if not self._server or not self._wants_to_send():
            return None
        if self.current is None:
            self.current = self.waiting.popleft()
            self._number = self.received - len(self.waiting)
            self._retries_left = self.config.retries if self.config.on_abort == "retry" else 0
        return self.current

    def sent(self, waypoint: Waypoint) -> None:
        """Records that the current waypoint was sent to move_base as ``waypoint``, possibly in another frame."""
        self.current = waypoint
        self._under_way = True
        self._say(f"driving to {self._named()}, {len(self.waiting)} waiting")

    def server_found(self) -> None:
        """Records that move_base is connected."""
        self._server = True
        self._say(f"{self._action} is running")

    def server_lost(self) -> None:
        """Records that move_base has disconnected; an active waypoint will be due again after a reconnect."""
        self._server = self._under_way = False
        self._say(
            f"{self._action} disconnected"
            + (f"; {self._named()} will be sent again" if self.current else ""),
            trouble=True,
        )

    def finished(self, outcome: Outcome, reason: str = "") -> None:
        """Records how the active goal ended; ``reason`` is move_base's own text. Does nothing if no goal is active."""
        if not self._under_way:
            return
        self._under_way = False
        match outcome:
            case Outcome.REACHED:
                self.reached += 1
                self.rest = self.current.wait if self.current else 0.0
                stay = f", staying {self.rest:g} s" if self.rest > 0.0 else ""
                self._say(f"reached {self._named()}{stay}, {len(self.waiting)} waiting")
                self._drop_current()
            case Outcome.ABORTED:
                self._give_up(f": {reason}" if reason else "")
            case Outcome.CANCELLED:
                self._held = bool(self.waiting or self._patrol)
                self._say(
                    f"{self._named()} was cancelled by another client{self._remainder()}",
                    trouble=True,
                )
                self._drop_current()
            case Outcome.LOST:
                self._say(
                    f"{self._action} no longer knows {self._named()}; it is sent again",
                    trouble=True,
                )
        self._go_round()

    def take_events(self) -> list[Event]:
        """Returns the events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def _give_up(self, reason: str) -> None:
        if self._retries_left > 0:
            self._retries_left -= 1
            self._say(
                f"{self._action} gave up {self._named()}{reason}; trying again, {self._retries_left} retries left",
                trouble=True,
            )
            return
        self.aborted += 1
        if self.config.on_abort == "stop":
            self._held = bool(self.waiting or self._patrol)
        if self.config.on_abort == "clear":
            self._drop_waiting()
            self._patrol = None
        self._say(f"gave up {self._named()}{reason}{self._remainder()}", trouble=True)
        self._drop_current()

    def _go_round(self) -> None:
        """Starts the next round of a patrol once the last one is over; ends it after a round without success."""
        patrol = self._patrol
        if (
            patrol is None
            or self.current is not None
            or self.waiting
            or self._held
            or self.rest > 0.0
        ):
            return
        if self._round > 0 and self.reached == self._reached_before:
            self._patrol = None
            self._say(
                f"the patrol ends: no waypoint of round {self._round} was reached", trouble=True
            )
        elif self._round == patrol.rounds > 0:
            self._patrol = None
            self._say(
                f"the patrol is done: {self._round} rounds of {len(patrol.waypoints)} waypoints"
            )
        else:
            self._round += 1
            self._reached_before = self.reached
            self._say(f"round {self._round} of the patrol: {len(patrol.waypoints)} waypoints")
            for waypoint in patrol.waypoints:
                self._append(waypoint)

    def _remainder(self) -> str:
        if self._held:
            return f"; {len(self.waiting)} held until a new waypoint comes"
        return f"; {len(self.waiting)} waiting"

    def _wants_to_send(self) -> bool:
        stays = self._under_way or self._held or self.rest > 0.0
        return not stays and (self.current is not None or bool(self.waiting))

    def _named(self) -> str:
        return f"waypoint {self._number} {self.current}"

    def _append(self, waypoint: Waypoint) -> None:
        self.received += 1
        self.waiting.append(waypoint)

    def _drop_current(self) -> None:
        self.current, self._under_way = None, False

    def _drop_waiting(self) -> None:
        self.waiting.clear()
        self._held = False

    def _say(self, text: str, trouble: bool = False) -> None:
        self.text = text
        self._events.append(Event(text, trouble))
