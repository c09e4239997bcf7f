"""Lockstep: simulated time waits at the end of each period until every member is done (docs/lockstep.md)."""

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial

import rospy
from pioneer_msgs.msg import LockstepToken
from std_msgs.msg import String

from pioneer_gazebo.lockstep.lockstep import Lockstep, LockstepError, Ring
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.ros.messages import joined_transforms, seconds_nanoseconds
from pioneer_gazebo.simulation.schedule import nanoseconds, period_of
from pioneer_node.core.parameter import ParameterError
from pioneer_node.core.ring import INLET, OUTLET, PROBE, ring_topic
from pioneer_node.nodes.exchange import Exchange
from pioneer_node.nodes.lockstep import RINGS, WITHHELD, Link, ring_publisher

_ASK_EVERY = 0.2
"""Interval at which absent rings are asked to join [s of wall time]."""
_RESEND_AFTER, _RESEND_PAUSE = 1.0, 8.0
"""Delay before an unreturned token is resent, and maximum pause between resends [s of wall time]."""
_ANSWER = 2.0
"""Time limit for members to answer a probe [s of wall time]."""
_SAY_AFTER = 5.0
"""Interval between reports of a start that waits for rings [s of wall time]."""


@dataclass(frozen=True, slots=True)
class LockstepConfig:
    """Parameters ``~lockstep/…``."""

    #: names of the rings that the first period waits for, separated by blanks; empty for the rings of all robots
    rings: str = ""
    rate: float = 20.0  #: periods per simulated second [Hz]
    deadline: float = 60.0  #: time limit of a period [s of wall time]; 0 for none
    silence: str = "abort"  #: after the deadline ``abort`` ends the simulator, ``drop`` continues without that ring

    def __post_init__(self) -> None:
        """Rejects invalid values; raises ParameterError."""
        if self.silence not in ("abort", "drop"):
            raise ParameterError(f"~lockstep/silence must be abort or drop, not {self.silence!r}")
        if not self.deadline >= 0:
            raise ParameterError(f"~lockstep/deadline must not be negative, not {self.deadline:g}")


class LockstepGate:
    """Holds simulated time at the end of each period until all rings have returned their tokens.

    Subscribes: ``RING/lockstep/done`` of each ring; ``/lockstep/rings``, ``/lockstep/withheld`` (std_msgs/String): the
            rings that take part, and what tokens do not carry, from the next period on; separated by blanks.

    Publishes: ``RING/lockstep/period``, ``RING/lockstep/probe``.

    Threads: the simulation's, except for `Exchange` and subscribers, which put tokens into the mailbox.
    """

    def __init__(
        self, config: LockstepConfig, mailbox: Mailbox, namespaces: Callable[[], Collection[str]]
    ) -> None:
        """Replaces rospy's publishers and subscribers from now on.

        Args:
            config: parameters.
            mailbox: of the simulation.
            namespaces: returns the namespaces of the robots in the world.

        Raises:
            RateError: the rate does not divide the tick rate.
        """
        self.exchange = Exchange(rospy.get_name()).install(follows=False)
        #: until: the tick at which the current period ends
        self.period = self.until = period_of(config.rate, "~lockstep/rate")
        self._config, self._mailbox, self._namespaces = config, mailbox, namespaces
        self.changed: Callable[[], None] = lambda: (
            None
        )  #: called when the set of wanted topics has changed
        self._state = Lockstep()
        self._expected: list[str] | None = None
        self._inlets: dict[str, rospy.Publisher] = {}
        self._probes: dict[str, rospy.Publisher] = {}
        self._outlets: dict[str, Link] = {}
        self._tokens: dict[str, LockstepToken] = {}
        self._resend_after = _RESEND_AFTER
        self._began = self._asked = self._said = time.monotonic()
        self._probed: float | None = None
        self._answers: dict[str, LockstepToken] = {}
        rospy.Subscriber(
            RINGS,
            String,
            lambda message: mailbox.post(partial(self._expect, _ring_names(message.data))),
        )
        rospy.Subscriber(
            WITHHELD,
            String,
            lambda message: mailbox.post(partial(self._withhold, message.data.split())),
        )

    def holds(self, tick: int) -> bool:
        """Returns whether time stands still at ``tick``; asks absent rings to join, and probes late members.

        Raises:
            LockstepError: a member does not respond, and the run must end.
        """
        state = self._state
        if not state.begun and not state.rings:
            self._listen(_ring_names(self._config.rings) or self._namespaces())
        if self._expected is not None and not state.late:
            self._listen(self._expected)
            self._expected = None
        if state.absent and time.monotonic() - self._asked > _ASK_EVERY:
            self._asked = time.monotonic()
            self._ask(tick)
        if state.late:
            self._watch()
        if not state.stands and not state.begun:
            self._want()  # wanted topics, for the first period's tokens
        return state.stands

    def reached(self, tick: int) -> None:
        """Sends the tokens of the period that ends at ``tick``."""
        if tick < self.until:
            return
        self.until = tick + self.period
        state, exchange = self._state, self.exchange
        state.subscribe(exchange.topics())
        exchange.partners = tuple(state.members)
        if any(not ring.told for ring in state.rings.values()):
            self._want()
        stamp, own = _time(tick), exchange.take(joined_transforms)
        self._began, self._probed, self._resend_after = time.monotonic(), None, _RESEND_AFTER
        for ring, messages in state.begin_period(own):
            members, wants = (
                ([], []) if ring.told else ([exchange.name, *state.members], sorted(state.wants))
            )
            ring.told = True
            token = LockstepToken(
                LockstepToken.PERIOD, state.period, stamp, members, wants, messages
            )
            self._tokens[ring.name] = token
            self._inlets[ring.name].publish(token)

    def _want(self) -> None:
        if self.exchange.wanted != self._state.wants:
            self.exchange.set_wanted(self._state.wants)
            self.changed()

    def restart(self) -> None:
        """Restarts at tick 0; members see time jump back."""
        self.until = self.period

    def _expect(self, names: list[str]) -> None:
        self._expected = names

    def _withhold(self, names: list[str]) -> None:
        self._state.withheld = frozenset(names)

    def _listen(self, names: Collection[str]) -> None:
        """Connects to the rings that are to take part."""
        self._state.expect(names)
        for name in self._state.rings.keys() - self._inlets.keys():
            self._inlets[name] = ring_publisher(ring_topic(name, INLET))
            self._probes[name] = ring_publisher(ring_topic(name, PROBE))
            self._outlets[name] = Link(ring_topic(name, OUTLET), partial(self._receive, name))

    def _receive(self, ring: str, token: LockstepToken) -> None:
        self._mailbox.post(partial(self._take, ring, token))

    def _take(self, name: str, token: LockstepToken) -> None:
        if token.kind == LockstepToken.JOIN:
            if self._state.join(name, token.members, token.wants):
                rospy.loginfo("lockstep: %s takes part: %s", name or "/", ", ".join(token.members))
        elif token.kind != LockstepToken.PERIOD:
            self._answers.update(dict.fromkeys(token.members, token))
        elif self._state.take(name, token.period, token.messages):
            self.exchange.deliver(self._state.end_period())

    def _ask(self, tick: int) -> None:
        for ring in self._state.absent:
            token = LockstepToken(LockstepToken.JOIN, self._state.period, _time(tick), [], [], [])
            self._outlets[ring.name].keep_connected()
            self._inlets[ring.name].publish(token)
        if self._state.stands and time.monotonic() - self._said > _SAY_AFTER:
            self._said = time.monotonic()
            rospy.loginfo(
                "lockstep waits for %s", ", ".join(ring.name or "/" for ring in self._state.absent)
            )

    def _watch(self) -> None:
        """Resends tokens to late rings; probes them after the deadline, and then decides how to proceed."""
        now, deadline = time.monotonic(), self._config.deadline
        if now - self._began > self._resend_after:
            self._resend_after += min(self._resend_after + _RESEND_AFTER, _RESEND_PAUSE)
            # Members that have finished the period pass their own token on.
            for ring in self._state.late:
                rospy.loginfo(
                    "lockstep: sending %s the token of period %d again",
                    ring.name or "/",
                    self._state.period,
                )
                self._outlets[ring.name].keep_connected()
                self._inlets[ring.name].publish(self._tokens[ring.name])
        if not deadline or now - self._began < deadline:
            return
        if self._probed is None:
            self._probed, self._answers = now, {}
            for ring in self._state.late:
                self._probes[ring.name].publish(
                    LockstepToken(LockstepToken.PROBE, self._state.period, rospy.Time(), [], [], [])
                )
        elif now - self._probed > _ANSWER:
            self._decide()

    def _decide(self) -> None:
        """Ends the run, or continues without the late rings.

        Raises:
            LockstepError: the run must end.
        """
        late = self._state.late
        text = "; ".join(self._fault(ring) for ring in late)
        text = f"lockstep: period {self._state.period} was not done within {self._config.deadline:g} s: {text}"
        if self._config.silence == "abort":
            raise LockstepError(text)
        rospy.logerr(
            "%s; continuing without %s", text, ", ".join(ring.name or "/" for ring in late)
        )
        for ring in late:
            self._state.drop(ring)
        self.exchange.deliver(self._state.end_period())

    def _fault(self, ring: Ring) -> str:
        """Returns which member of a ring failed, and how."""
        for member in ring.members:
            answer = self._answers.get(member)
            if answer is None:
                return f"{member} does not answer"
            if answer.kind == LockstepToken.WORKING:
                return f"{member} is still at work"
            if answer.period < self._state.period:
                return f"{member} has not received the token"
        return f"the token of {ring.name or '/'} is lost on its way back"


def _ring_names(text: str) -> list[str]:
    """Returns the names of rings in a text, separated by blanks; ``/`` is the ring without a namespace."""
    return [name.strip("/") for name in text.split()]


def _time(tick: int) -> rospy.Time:
    return rospy.Time(*seconds_nanoseconds(nanoseconds(tick)))
