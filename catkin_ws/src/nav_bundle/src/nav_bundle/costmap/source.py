"""An observation source: which of its messages are used, and whether it is current.

A source is judged by the messages that reach the costmap. Messages that arrive and cannot be placed, that do not
parse, or that hold no measurement leave the robot as blind as silence does.
"""

import math
from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

from nav_bundle.base.error import ObservationError
from nav_bundle.base.transform import ExtrapolationError, TransformError
from nav_bundle.costmap.config import SourceConfig
from nav_bundle.costmap.layer import Observation, ObservationBuffer

Message = TypeVar("Message")

_EQUAL = 1.0e-6
"""Times that differ by less are equal [s]."""
_AHEAD = 0.1
"""A stamp that was farther ahead of the clock at its arrival does not only wait for a late transform [s]."""
_UNPARSED = "its messages do not parse"


class Arrival(NamedTuple, Generic[Message]):
    """A message and its arrival; times are ROS times [s]."""

    number: int  #: counts the messages of a topic
    received: float  #: time of arrival
    stamp: float  #: stamp of the header; 0: valid at the newest transform, as in tf2
    message: Message


class Limits(NamedTuple):
    """What a costmap allows its sources."""

    update_period: float  #: time between two updates of the costmap [s]
    #: how much older than ``expected_update_rate`` a stamp may be [s], for clocks that differ
    tolerance: float


class _Used(NamedTuple):
    """The newest message that is in the costmap."""

    number: int
    received: float
    stamp: float


class Source(Generic[Message]):
    """The observations of one source, and the judgement of whether it is current.

    Not thread-safe.

    Args:
        config: parameters of the source.
    """

    def __init__(self, config: SourceConfig) -> None:
        self.config = config
        self.buffer = ObservationBuffer(
            config.observation_persistence
        )  #: observations in the costmap's frame
        self.refusal = ""  #: why the newest message that was refused at the last update cannot be used; else empty
        self._used: _Used | None = None
        self._waits_for = ""
        self._ahead = (
            -math.inf
        )  # of the messages that wait for a transform, how far the farthest was ahead [s]
        self._updated = -math.inf

    def update(
        self,
        arrivals: Iterable[Arrival[Message]],
        place: Callable[[Arrival[Message]], Observation],
        now: float,
    ) -> None:
        """Takes what can be used of the messages that came since the last update.

        Args:
            arrivals: the messages, newest first; each is looked at only if the newer ones did not suffice.
            place: returns the observation of a message; raises TransformError or ObservationError.
            now: ROS time [s].
        """
        self._updated = now
        self.refusal = self._waits_for = ""
        self._ahead = -math.inf
        last = -1 if self._used is None else self._used.number
        placed = []
        for arrival in arrivals:
            if arrival.number <= last:
                break
            observation = self._placed(arrival, place)
            if observation is None:
                continue
            placed.append((arrival, observation))
            if self.buffer.persistence <= 0.0:
                break
        for arrival, observation in reversed(placed):
            self.buffer.add(arrival.stamp or now, observation)
            self._used = _Used(arrival.number, arrival.received, arrival.stamp)

    def _placed(
        self, arrival: Arrival[Message], place: Callable[[Arrival[Message]], Observation]
    ) -> Observation | None:
        """Returns the observation of a message; notes the reason and returns None if it cannot be used."""
        try:
            return place(arrival)
        except (TransformError, ObservationError) as error:
            if isinstance(error, ExtrapolationError) and error.future:
                self._waits_for = self._waits_for or str(error)
                self._ahead = max(self._ahead, arrival.stamp - arrival.received)
            else:
                self.refusal = self.refusal or str(error)
        return None

    def fault(
        self, received: float | None, now: float, limits: Limits, not_updated: str = ""
    ) -> str:
        """Returns why the source is not current at ``now`` [s]; empty if it is, or is not checked.

        Args:
            received: time of the last arrival [s]; None before the first.
            now: ROS time [s].
            limits: of the costmap.
            not_updated: why the costmap cannot be updated; empty if it can, or if that is not known.
        """
        update_period, tolerance = limits
        cannot = f"The costmap cannot be updated: {not_updated}" if not_updated else ""
        rate = self.config.expected_update_rate
        topic = self.config.topic
        if rate <= 0.0:
            return ""
        silence = self._silence(received, now)
        if silence or received is None:
            return silence
        if math.isinf(self._updated):
            return (
                cannot or f"The costmap cannot be updated: no message on {topic} has been used yet."
            )
        if now - self._updated > rate + update_period:
            return cannot or f"The costmap has not been updated for {now - self._updated:.2f} s."
        reason = self.refusal or self._waits_for or _UNPARSED
        if self._used is None:
            return f"no message on {topic} can be used: {reason}"
        age_at_update = self._updated - self._used.received
        age = now - self._used.received
        if age_at_update > rate - _EQUAL or age > rate + update_period + _EQUAL:
            return f"{self._outdated(age)} Newer messages cannot be used: {reason}"
        return self._belated(self._used, tolerance)

    def own_fault(self, received: float | None, now: float, tolerance: float) -> str:
        """Returns what is wrong with the messages themselves, in a costmap that is not updated; empty if nothing is.

        Args:
            received: time of the last arrival [s]; None before the first.
            now: ROS time [s].
            tolerance: see ``Limits``.
        """
        rate = self.config.expected_update_rate
        if rate <= 0.0:
            return ""
        silence = self._silence(received, now)
        if silence or self._used is None:
            return silence or self.refusal
        age = now - self._used.received
        reason = self._own_reason(self._used)
        if reason and age > rate:
            return f"{self._outdated(age)} Newer messages cannot be used: {reason}"
        return self._belated(self._used, tolerance)

    def _own_reason(self, used: _Used) -> str:
        """Returns why messages could not be used at the last update, unless they only waited for a late transform."""
        if self.refusal:
            return self.refusal
        if self._waits_for:
            return self._waits_for if self._ahead > _AHEAD else ""
        is_unused = self._updated - used.received > self.config.expected_update_rate - _EQUAL
        return _UNPARSED if is_unused else ""

    def _belated(self, used: _Used, tolerance: float) -> str:
        """Returns that the newest message was stamped too far in the past; empty if it was not."""
        delay = self._updated - used.stamp
        allowed = self.config.expected_update_rate + tolerance
        if used.stamp <= 0.0 or delay <= allowed:
            return ""
        return (
            f"The messages on {self.config.topic} are stamped {delay:.2f} s in the past, "
            f"more than {allowed:.2f} s."
        )

    def _silence(self, received: float | None, now: float) -> str:
        """Returns why the source counts as silent; empty if messages arrive in time."""
        if received is None:
            return f"no scans on {self.config.topic} yet"
        age = now - received
        return self._outdated(age) if age > self.config.expected_update_rate else ""

    def _outdated(self, age: float) -> str:
        return (
            f"The {self.config.topic} observation buffer has not been updated for {age:.2f} seconds, "
            f"and it should be updated every {self.config.expected_update_rate:.2f} seconds."
        )

    def forget(self) -> None:
        """Drops all observations after the clock jumped back."""
        self.buffer.forget()
        self.refusal = self._waits_for = ""
        self._used = None
        self._updated = -math.inf
