"""Keeps this gateway registered on one hub, in a separate thread, and reports changes."""

import contextlib
import errno
import logging
import os
import random
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import redis

from rocon_gateway.hub.address import own_address
from rocon_gateway.hub.presence import Candidate, HubView
from rocon_gateway.hub.session import (
    ALIVE,
    HEARTBEAT,
    Description,
    HubSession,
    event_from_message,
)
from rocon_gateway.hub.state import HubState, Publication
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import EXAMINE_KEY
from tcpros.descriptor import readable
from tcpros.header import printable
from tcpros.loop_faults import LoopFaults

RETRY = 0.5
"""Average pause between two attempts to connect to a hub [s]; see `retry_pause`."""

RETRY_REFUSED = 5.0
"""Pause after a running hub refused us, or we refused it [s]."""

_REFUSALS = (
    Code.HUB_CONNECTION_ALREADY_EXISTS,
    Code.HUB_CONNECTION_BLACKLISTED,
    Code.HUB_CONNECTION_NOT_IN_NONEMPTY_WHITELIST,
)


def retry_pause() -> float:
    """Returns a randomised pause [s], so that a fleet does not reconnect all at once when its hub is back."""
    return RETRY * random.uniform(0.5, 1.5)


@dataclass(frozen=True)
class HubContext:
    """Callbacks and settings shared by all our hubs."""

    #: returns a new session with a hub if we may join it; otherwise raises HubError
    open: Callable[[Candidate], HubSession]
    #: called with ourselves and a session; raises HubError if we are on that hub already
    claim: Callable[["HubClient", HubSession], None]
    linked: Callable[[], Collection[str]]  #: returns the gateways with open data links
    #: called from the hub's thread with each new view, and with None when the thread ends
    take: Callable[["HubClient", HubView | None], None]
    complain: Callable[
        [object, str], None
    ]  #: called with an address and the reason why there is no hub
    #: called with a session and the id of an examination request; does not block
    examine: Callable[[HubSession, str], None]
    logger: logging.Logger  #: receives one line when a hub is found and one when it is lost
    host: str = ""  #: our address for other gateways; empty: the one on the route to the hub
    namespaces: frozenset[str] = frozenset()  #: robot namespaces to announce to all
    #: called before we join with the text that the hub has stored for us; returns the text to store from now on
    restore: Callable[[str], str] = lambda text: text
    #: called before we join with the hub's salt, and when it changes; the second one is the former salt
    learn: Callable[[str, str], None] = lambda _salt, _former: None


class HubClient:
    """Membership in one hub. Reconnects without limit when the hub is lost.

    Methods may be called from any thread and do not block, except `describe`, which waits for the hub.

    Args:
        ways: addresses of the hub, tried in order.
        named: whether the user configured this hub; otherwise the thread ends if this gateway does not accept the hub.
        said: what we publish initially.
        context: shared callbacks and settings.

    Raises:
        OSError: no descriptor or thread is available.
    """

    def __init__(
        self, ways: Sequence[Candidate], named: bool, said: Publication, context: HubContext
    ) -> None:
        self.ways = tuple(ways)
        self.named = named
        self.lost_since = (
            time.monotonic()
        )  #: when the hub was last connected for a while, or first tried; monotonic [s]
        self.refused = False  #: whether this gateway refused the hub at the last attempt
        #: number of failed rounds over all addresses since it was last connected for longer than `ALIVE`
        self.failures = 0
        self._context = context
        self._state = HubState(said, context.namespaces)
        self._shown = HubView()
        self._session: HubSession | None = None
        self._keep = self._kept = ""
        self._salt = ""
        self._told_lost = False
        self._faults = LoopFaults(context.logger, f"the membership in the hub at {ways[0].address}")
        self._reported_faults: dict[str, str] = {}
        self._nameless: set[Candidate] = set()
        self._stopping = False
        self._pipe = threading.Lock()
        self._wake_reader, self._wake_writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._thread = threading.Thread(
            target=self._run, name=f"hub {self.ways[0].address}", daemon=True
        )
        try:
            self._thread.start()
        except RuntimeError as error:  # no more threads on this machine
            os.close(self._wake_reader)
            os.close(self._wake_writer)
            raise OSError(errno.EAGAIN, str(error)) from None

    def publish(self, said: Publication) -> None:
        """Sets what we publish."""
        self._state.said = said
        self._wake()

    def keep(self, text: str) -> None:
        """Sets the text that the hub stores for the next gateway of our name; written with the next heartbeat."""
        self._keep = text

    def describe(self, names: Collection[str]) -> list[Description]:
        """Returns what the hub knows of these gateways, or of all if empty; an empty list without a connection."""
        session = self._session
        if session is None:
            return []
        try:
            return session.describe(names)
        except (redis.RedisError, OSError):
            return []

    def stop(self) -> None:
        """Starts deregistering; `join` waits for its end."""
        self._stopping = True
        self._wake()

    def join(self) -> None:
        """Waits for the thread to end after `stop`, only briefly if the hub does not answer."""
        # The thread may be in a call that takes seconds; then it ends with the process, and we expire on the hub.
        self._thread.join(1.5 if self._session else 0.3)

    def _wake(self) -> None:
        with self._pipe, contextlib.suppress(BlockingIOError):
            if self._wake_writer >= 0:
                os.write(self._wake_writer, b"x")

    # The thread

    def _run(self) -> None:
        while not self._stopping:
            verdicts = [self._try(way) for way in self.ways]
            self.refused = all(verdicts)
            self.failures += 1
            if self.refused and not self.named:
                break
            self._pause(RETRY_REFUSED if self.refused else retry_pause())
        with self._faults:
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

    def _try(self, way: Candidate) -> bool:
        """Visits the hub at this address; an unexpected exception costs only this visit. Returns as `_visit`."""
        with self._faults:
            return self._visit(way)
        return False

    def _visit(self, way: Candidate) -> bool:
        """Connects to the hub at this address and stays on it as long as possible; returns whether it was refused."""
        if self._stopping:
            return False
        session = None
        try:
            session = self._context.open(way)
            self._context.claim(self, session)
            self._learn(session)
            self._enter(session)
        except (HubError, redis.RedisError, OSError) as error:
            code = error.code if isinstance(error, HubError) else Code.HUB_CONNECTION_UNRESOLVABLE
            if self._is_news(way, code):
                self._context.complain(way.address, str(error))
            if session:
                session.close()
            return code in _REFUSALS
        except Exception:
            if session:
                session.close()
            raise
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
            # A starting hub has a Redis first and a name a moment later. Report it only if the next attempt fails too.
            is_known = way in self._nameless
            self._nameless.add(way)
            return is_known
        self._nameless.discard(way)
        # An unreachable hub is no news if we have just reported it as lost.
        return not (self._told_lost and code == Code.HUB_CONNECTION_UNRESOLVABLE)

    def _enter(self, session: HubSession) -> None:
        self._keep = self._context.restore(session.kept())
        host = self._context.host or own_address(session.address.host)
        self._state.enter(session, host, time.monotonic())
        # Read again: until we joined, another gateway of our name could write it.
        self._kept = session.kept()
        self._session, self._told_lost = session, False
        self._nameless.clear()
        self._context.logger.info(
            "on hub '%s' at %s as '%s'", session.hub_name, session.address, session.name
        )

    def _learn(self, session: HubSession) -> None:
        """Passes the hub's salt on if it is new; the hub changes it with the password."""
        if session.salt != self._salt:
            self._context.learn(session.salt, self._salt)
            self._salt = session.salt

    def _exit(self, session: HubSession) -> None:
        self._session = None
        if not self.failures:
            self.lost_since = time.monotonic()
        with contextlib.suppress(redis.RedisError, OSError):
            if self._stopping:
                session.leave()
        session.close()
        self._state.leave()
        self._show()

    def _stay(self, session: HubSession) -> None:
        begun = beat = time.monotonic()
        while not self._stopping:
            linked = self._context.linked() if self._state.waiting else ()
            self._state.update(session, linked, time.monotonic())
            self._show()
            self._state.write(session)
            if time.monotonic() >= beat:
                if self._state.heartbeat(session):
                    self._kept = session.kept()
                # Only now: a server that lets us join and then answers badly must give way to other hubs.
                if time.monotonic() - begun > ALIVE:
                    self.failures = 0
                self._learn(session)
                if (keep := self._keep) != self._kept and session.keep(keep):
                    self._kept = keep
                # Counted from the end of the heartbeat, so that even with a slow hub there is time for events.
                beat = time.monotonic() + HEARTBEAT
            self._wait(session, 0.1 if self._state.waiting else max(0.0, beat - time.monotonic()))
            self._state.take(session, self._events(session, beat), time.monotonic())
            self._report_faults(session)

    def _report_faults(self, session: HubSession) -> None:
        """Logs each invalid record once."""
        if self._state.faults == self._reported_faults:
            return
        for name, fault in self._state.faults.items():
            if self._reported_faults.get(name) != fault:
                self._context.logger.warning(
                    "gateway '%s' has an invalid record on hub '%s' and is left out: %s",
                    printable(name),
                    session.hub_name,
                    printable(fault),
                )
        self._reported_faults = dict(self._state.faults)

    def _wait(self, session: HubSession, seconds: float) -> None:
        # Events may be buffered already, read together with others or with the answer to a subscription.
        if session.events.connection.can_read():
            return
        ready = readable([session.events.connection._sock, self._wake_reader], seconds)
        if self._wake_reader in ready:
            self._drain()

    def _events(self, session: HubSession, beat: float) -> Iterator[tuple[str, str]]:
        """Yields channel and text of received events until the next heartbeat is due."""
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
