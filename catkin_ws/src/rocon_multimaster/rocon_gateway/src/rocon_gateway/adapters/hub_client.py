"""Our place on one hub: a thread that keeps us registered there and tells when something changed."""

import contextlib
import logging
import os
import random
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import redis

from rocon_gateway.adapters.address import own_address
from rocon_gateway.adapters.hub_session import HEARTBEAT, Description, HubSession, event_from_message
from rocon_gateway.core.hub_state import HubState, Publication
from rocon_gateway.core.presence import Candidate, HubView
from rocon_hub_protocol.core.code import Code, HubError
from rocon_hub_protocol.core.key import EXAMINE_KEY
from tcpros.adapters.descriptor import readable

RETRY = 0.5
"""Pause between two tries to reach a hub [s], on the average; see `retry_pause`."""

RETRY_REFUSED = 5.0
"""Pause after a running hub did not accept us, or we not it [s]."""

_REFUSALS = (
    Code.HUB_CONNECTION_ALREADY_EXISTS,
    Code.HUB_CONNECTION_BLACKLISTED,
    Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST,
)


def retry_pause() -> float:
    """Returns a pause that is another one each time, so that a fleet whose hub is back does not come all at once."""
    return RETRY * random.uniform(0.5, 1.5)


@dataclass(frozen=True)
class HubContext:
    """What all our hubs share."""

    #: returns a new session with a hub, if we may join it; else raises HubError
    open: Callable[[Candidate], HubSession]
    #: called with ourselves and a session; raises HubError if we are on that hub already
    claim: Callable[["HubClient", HubSession], None]
    linked: Callable[[], Collection[str]]  #: returns the gateways to which data links stand
    #: called from the hub's thread with each new view, None when it ends
    take: Callable[["HubClient", HubView | None], None]
    complain: Callable[[object, str], None]  #: called with an address and why there is no hub
    #: called with a session and the number of a request to look at our links; returns at once
    examine: Callable[[HubSession, str], None]
    logger: logging.Logger  #: takes one line when a hub is found and one when it is lost
    host: str = ""  #: our address for others; empty: the one on the way to the hub
    namespaces: frozenset[str] = frozenset()  #: of robots, to announce to all
    #: called with what the hub has kept for us, before we join; returns what it is to keep from now on
    restore: Callable[[str], str] = lambda text: text


class HubClient:
    """One hub, joined while it is running, tried again without end when it is not.

    Methods return at once and may be called from any thread, `describe` apart, which waits for the hub.

    Args:
        ways: addresses of the hub, to be tried in order.
        named: whether a user named it; otherwise it ends when this gateway does not accept the hub.
        said: what we tell at first.
        context: see there.
    """

    def __init__(self, ways: Sequence[Candidate], named: bool, said: Publication, context: HubContext) -> None:
        self.ways = tuple(ways)
        self.named = named
        self.lost_since = time.monotonic()  #: when the hub was seen last, or looked for first; monotonic [s]
        self.refused = False  #: whether this gateway does not accept the hub as it was found last
        self.failures = 0  #: how often all its addresses were tried since it was joined last
        self._context = context
        self._state = HubState(said, context.namespaces)
        self._shown = HubView()
        self._session: HubSession | None = None
        self._keep = self._kept = ""
        self._told_lost = False
        self._nameless: set[Candidate] = set()
        self._stopping = False
        self._pipe = threading.Lock()
        self._wake_reader, self._wake_writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name=f"hub {self.ways[0].address}", daemon=True)
        self._thread.start()

    def publish(self, said: Publication) -> None:
        """Sets what we tell."""
        self._state.said = said
        self._wake()

    def keep(self, text: str) -> None:
        """Sets what the hub is to keep for the next gateway of our name; it is written with the next heartbeat."""
        self._keep = text

    def describe(self, names: Collection[str]) -> list[Description]:
        """Returns what the hub knows of these gateways, of all if empty. Without a connection, nothing."""
        session = self._session
        if session is None:
            return []
        try:
            return session.describe(names)
        except (redis.RedisError, OSError):
            return []

    def stop(self) -> None:
        """Deregisters; `join` waits until that is done."""
        self._stopping = True
        self._wake()

    def join(self) -> None:
        """Waits for the end after `stop`; not long for a hub that does not answer."""
        # The thread may be in a call that takes seconds; it ends with the process, and the hub sees us expire.
        self._thread.join(1.5 if self._session else 0.3)

    def _wake(self) -> None:
        with self._pipe, contextlib.suppress(BlockingIOError):
            if self._wake_writer >= 0:
                os.write(self._wake_writer, b"x")

    # The thread

    def _run(self) -> None:
        while not self._stopping:
            verdicts = [self._visit(way) for way in self.ways]
            self.refused = all(verdicts)
            self.failures += 1
            if self.refused and not self.named:
                break
            self._pause(RETRY_REFUSED if self.refused else retry_pause())
        self._context.take(self, None)
        with self._pipe:
            os.close(self._wake_reader)
            os.close(self._wake_writer)
            self._wake_writer = -1

    def _pause(self, seconds: float) -> None:
        if not self._stopping:
            readable([self._wake_reader], seconds)
        self._drain()

    def _drain(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._wake_reader, 4096)

    def _visit(self, way: Candidate) -> bool:
        """Stays on the hub at this address as long as possible; returns whether this gateway does not accept it."""
        if self._stopping:
            return False
        session = None
        try:
            session = self._context.open(way)
            self._context.claim(self, session)
            self._enter(session)
        except (HubError, redis.RedisError, OSError) as error:
            code = error.code if isinstance(error, HubError) else Code.HUB_CONNECTION_UNRESOLVABLE
            if self._is_news(way, code):
                self._context.complain(way.address, str(error))
            if session:
                session.close()
            return code in _REFUSALS
        try:
            self._stay(session)
        except (HubError, redis.RedisError, OSError) as error:
            if not self._stopping:
                self._told_lost = True
                text = "hub '%s' lost (%s); running links stay up, reconnecting"
                self._context.logger.warning(text, session.hub_name, error)
        finally:
            self._exit(session)
        return False

    def _is_news(self, way: Candidate, code: Code) -> bool:
        if code == Code.HUB_NAME_NOT_FOUND:
            # A hub that starts has a Redis first and a name a moment later: it is none if that is still so next time.
            is_known = way in self._nameless
            self._nameless.add(way)
            return is_known
        self._nameless.discard(way)
        # That nothing answers there is no news of a hub that we have just said is lost.
        return not (self._told_lost and code == Code.HUB_CONNECTION_UNRESOLVABLE)

    def _enter(self, session: HubSession) -> None:
        self._kept = session.kept()
        self._keep = self._context.restore(self._kept)
        host = self._context.host or own_address(session.address.host)
        self._state.enter(session, host, time.monotonic())
        self._session, self._told_lost, self.failures = session, False, 0
        self._nameless.clear()
        self._context.logger.info("on hub '%s' at %s as '%s'", session.hub_name, session.address, session.name)

    def _exit(self, session: HubSession) -> None:
        self._session = None
        self.lost_since = time.monotonic()
        with contextlib.suppress(redis.RedisError, OSError):
            if self._stopping:
                session.leave()
        session.close()
        self._state.leave()
        self._show()

    def _stay(self, session: HubSession) -> None:
        beat = time.monotonic()
        while not self._stopping:
            linked = self._context.linked() if self._state.waiting else ()
            self._state.update(session, linked, time.monotonic())
            self._show()
            self._state.write(session)
            if time.monotonic() >= beat:
                self._state.heartbeat(session)
                if (keep := self._keep) != self._kept:
                    session.keep(keep)
                    self._kept = keep
                # From its end: however slow the hub is, there is time for events before the next one.
                beat = time.monotonic() + HEARTBEAT
            self._wait(session, 0.1 if self._state.waiting else max(0.0, beat - time.monotonic()))
            self._state.take(session, self._events(session, beat), time.monotonic())

    def _wait(self, session: HubSession, seconds: float) -> None:
        # Events may have been read from the socket already: together with others, or with the answer to a subscription.
        if session.events.connection.can_read():
            return
        ready = readable([session.events.connection._sock, self._wake_reader], seconds)
        if self._wake_reader in ready:
            self._drain()

    def _events(self, session: HubSession, beat: float) -> Iterator[tuple[str, str]]:
        """Yields channel and text of what has come, until the next sign of life is due."""
        while time.monotonic() < beat:
            message = session.events.get_message()
            if message is None and not session.events.connection.can_read():
                return
            if message is None:
                continue
            if message["channel"] == EXAMINE_KEY:
                if message["type"] == "message":
                    self._context.examine(session, message["data"])
            elif event := event_from_message(message):
                yield event

    def _show(self) -> None:
        if self._state.view != self._shown:
            self._shown = self._state.view
            self._context.take(self, self._shown)
