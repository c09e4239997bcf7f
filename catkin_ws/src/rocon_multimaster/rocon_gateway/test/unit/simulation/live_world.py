"""The fault schedules with the real `HubClient`: its thread, its waiting and each of its calls in simulated time.

In `world.World`, a visit of the hub takes no time. Here each command takes some, its answer may get lost after it was
executed, and everything else keeps running meanwhile.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest import mock

import redis
from process import HUB, Computer, Process
from redis_model import ClientModel, PipelineModel, RedisModel, Subscription
from schedule import Fault
from simulated_thread import SimulatedThread
from world import World

from rocon_gateway.hub import client as hub_client
from rocon_gateway.hub import session as hub_session
from rocon_gateway.hub.client import HubClient, HubContext
from rocon_gateway.hub.membership import Memberships, Overview
from rocon_gateway.hub.presence import Candidate, HubView
from rocon_gateway.hub.session import HubSession
from rocon_gateway.hub.state import Publication
from rocon_gateway.rules.situation import Outcome
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import kept_key
from rocon_hub_protocol.redis_client import OPEN, TIMEOUT

FAREWELL = 1.5
"""How long a gateway that ends waits for its hub client [s]."""

LOST = 0.02
"""Share of commands whose answer is lost while there are faults."""


class Faults(logging.Handler):
    """Collects log lines that report an error of the software."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))


class LiveWorld(World):
    """Everything that a fault schedule acts on; gateways run the real `HubClient`."""

    def __init__(self, seed: int, faults: Sequence[Fault]) -> None:
        self.log = Faults()
        self.logger = logging.Logger("simulation")
        self.logger.addHandler(self.log)
        self.threads: list[SimulatedThread] = []
        self.opening: list[LiveClient] = []  #: the connection of the session that is opened
        self.stack = ExitStack()
        self._replace()
        super().__init__(seed, faults)

    def run(self) -> str:
        """Runs the simulation; returns what is still wrong when it should have converged, or "" if nothing is."""
        try:
            wrong = super().run()
        finally:
            for process in tuple(self.listening.values()):
                process.end(orderly=False)
            for thread in self.threads:
                thread.kill()
            self.stack.close()
        failures = [repr(one.failure) for one in self.threads if one.failure]
        return "; ".join(filter(None, [wrong, *failures, *self.log.lines]))

    def fault(self) -> str:
        """Returns the first difference as `World` does, and then the first kept text that is not on the hub."""
        if wrong := super().fault():
            return wrong
        assert self.redis is not None
        for process in self.listening.values():
            assert isinstance(process, LiveProcess)
            stored = self.redis.get(kept_key(process.name))
            if stored != process.kept:
                return f"the hub keeps {stored!r} of {process.name}, not {process.kept!r}"
        return ""

    def make_process(self, name: str, computer: Computer) -> Process:
        """Starts a gateway."""
        return LiveProcess(self, name, computer)

    def thread(self, target: Callable[[], object], **_: object) -> SimulatedThread:
        """Replaces `threading.Thread`."""
        self.threads.append(SimulatedThread(self, target))
        return self.threads[-1]

    def delay(self) -> None:
        """Lets the time of half a command pass."""
        if thread := SimulatedThread.current:
            end = self.now + self.random.choice((0.0, 0.0001, 0.002, 0.02, 0.2))
            while self.now < end:
                thread.pause(end - self.now)

    def time_out(self) -> None:
        """Waits for an answer that does not come."""
        end = self.now + TIMEOUT
        while (thread := SimulatedThread.current) and self.now < end:
            thread.pause(end - self.now)

    def command(self, server: Callable[[], RedisModel], execute: Callable[[], Any]) -> Any:
        """Executes a command of a hub client: it takes time, and the command or its answer may get lost."""
        self.delay()
        try:
            server()
            result = execute()
        except redis.TimeoutError:
            self.time_out()
            raise
        if self.now < self.end and self.random.random() < LOST:
            self.time_out()
            raise redis.TimeoutError("Timeout reading from socket")
        self.delay()
        return result

    def readable(self, waited: Collection[Any], seconds: float) -> set[Any]:
        """Replaces `tcpros.descriptor.readable`, for the wake-up pipe and subscriptions."""
        thread = SimulatedThread.current
        assert thread is not None
        end = self.now + seconds
        while True:
            ready = {one for one in waited if self._is_readable(one)}
            if ready or self.now >= end:
                return ready
            thread.pause(end - self.now)

    @staticmethod
    def _is_readable(one: Any) -> bool:
        if isinstance(one, int):
            return bool(real_readable([one], 0.0))
        return bool(one.can_read())

    def _client(self, *_: object) -> LiveClient:
        return self.opening.pop()

    def _replace(self) -> None:
        """Replaces threads, time, chance and waiting in the hub client."""
        replaced: dict[str, Any] = {
            "threading": SimpleNamespace(Thread=self.thread, Lock=lambda: NoLock()),
            "time": SimpleNamespace(monotonic=lambda: self.now),
            "random": SimpleNamespace(uniform=lambda low, high: self.random.uniform(low, high)),
            "readable": self.readable,
        }
        for name, substitute in replaced.items():
            self.stack.enter_context(mock.patch.object(hub_client, name, substitute))
        # Taken at once by the session: threads that open sessions take turns, and each would undo another's patch.
        self.stack.enter_context(mock.patch.object(hub_session, "redis_client", self._client))
        no_hub = HubError(Code.HUB_CONNECTION_UNRESOLVABLE, "no hub there")
        self.stack.enter_context(mock.patch.object(hub_session, "unreachable", return_value=no_hub))


real_readable = hub_client.readable


class NoLock:
    """A lock of code that only one thread runs at a time."""

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


class LiveProcess(Process):
    """One run of a gateway: the compare loop as in `Process`, and the real hub client."""

    world: LiveWorld

    def __post_init__(self) -> None:
        self.port = next(self.world.numbers)
        self.instance = f"run {self.port}"
        self._memberships = Memberships()
        self._overview = Overview()
        self._turning = self._ended = False
        self._opening: Subscription | None = None
        said = Publication(self.record(Outcome()))
        self.state: Any = SimpleNamespace(said=said, waiting=False)
        self.kept = f"kept by {self.instance}"
        context = HubContext(
            open=self._open,
            claim=lambda _hub, _session: None,
            linked=self._linked,
            take=self._take_view,
            complain=lambda _address, _reason: None,
            examine=lambda _session, _request: None,
            logger=self.world.logger,
            host=self.name,
            restore=lambda _stored: self.kept,
        )
        self.hub = HubClient([Candidate(HUB)], True, said, context)
        self.thread = self.world.threads[-1]
        self.world.listening[self.port] = self
        self.wake()

    @property
    def session(self) -> HubSession | None:  # type: ignore[override]
        return self.hub._session

    @session.setter
    def session(self, _value: None) -> None:
        """The hub client has the session."""

    @property
    def events(self) -> Subscription | None:
        return self._opening

    def end(self, orderly: bool) -> None:
        if self._ended:
            return
        self._ended = True
        if orderly:
            self.hub.stop()
            self.thread.nudge()
            self.world.at(self.world.now + FAREWELL, self._kill)
        else:
            self._kill()
        self.world.listening.pop(self.port, None)
        self.world.restart_links()

    def take(self) -> None:
        self.thread.nudge()

    def _kill(self) -> None:
        """Ends the process; its kernel closes its connections and descriptors."""
        self.thread.kill()
        if self._opening is not None:
            self._opening.close()
        hub = self.hub
        if hub._wake_writer >= 0:
            os.close(hub._wake_reader)
            os.close(hub._wake_writer)
            hub._wake_writer = -1

    def _sync(self) -> None:
        self.hub.publish(self.state.said)
        if self.world.random.random() < 0.2:
            self.kept = f"kept by {self.instance} at {self.world.now}"
            self.hub.keep(self.kept)
        self.thread.nudge()

    def _open(self, _way: Candidate) -> HubSession:
        self.world.opening.append(LiveClient(self.world, self))
        return HubSession(HUB, OPEN, self.name, self.instance)

    def subscribed(self, events: Subscription) -> None:
        """Called with the session's subscription."""
        self._opening = events

    def _take_view(self, hub: HubClient, view: HubView | None) -> None:
        if view is not None and not self._ended:
            self.view = view
            self._overview = self._memberships.take(hub, view)
            self.wake()


class LiveClient(ClientModel):
    """A connection whose commands take time."""

    def __init__(self, world: LiveWorld, process: LiveProcess) -> None:
        super().__init__(process._server)
        self._world, self._process = world, process

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments, **options: self._world.command(
            self._server, lambda: getattr(self._server(), name)(*arguments, **options)
        )

    def pubsub(self) -> Subscription:
        events = self._world.command(self._server, lambda: LiveSubscription(self._server))
        events.world = self._world
        self._process.subscribed(events)
        return events

    def pipeline(self, transaction: bool = True) -> PipelineModel:
        return LivePipeline(self._world, self._server)


class LivePipeline(PipelineModel):
    """Commands that are executed together, unless a watched key has changed meanwhile."""

    def __init__(self, world: LiveWorld, server: Callable[[], RedisModel]) -> None:
        super().__init__(server)
        self._world = world
        self._watched: tuple[str, Any] | None = None

    def watch(self, key: str) -> None:
        super().watch(key)
        value = self._world.command(self._server, lambda: self._server().live(key))
        self._watched = key, value

    def __getattr__(self, name: str) -> Callable[..., Any]:
        found = super().__getattr__(name)
        if not self._watching:
            return found
        return lambda *arguments: self._world.command(self._server, partial(found, *arguments))

    def execute(self, raise_on_error: bool = True) -> list[Any]:
        def execute() -> list[Any]:
            if self._watched is not None:
                key, value = self._watched
                if self._server().live(key) != value:
                    raise redis.WatchError("Watched variable changed.")
            return super(LivePipeline, self).execute(raise_on_error)

        result: list[Any] = self._world.command(self._server, execute)
        return result


class LiveSubscription(Subscription):
    """A connection that receives events, read by the hub client itself."""

    world: LiveWorld

    def __init__(self, server: Callable[[], RedisModel]) -> None:
        super().__init__(server)
        self.connection = self
        self._sock = self

    def subscribe(self, *channels: str) -> None:
        self.world.command(self._server, lambda: super(LiveSubscription, self).subscribe(*channels))

    def unsubscribe(self, *channels: str) -> None:
        self.world.command(
            self._server, lambda: super(LiveSubscription, self).unsubscribe(*channels)
        )

    def can_read(self) -> bool:
        """Returns whether an event, or the end of the connection, has arrived."""
        return bool(self.arrived) or self._has_ended()

    def get_message(self, timeout: float = 0.0) -> Any:
        """Returns an event. While a session is opened, acknowledgements are not waited for: they arrive later."""
        if self.arrived:
            return self.arrived.pop(0)
        if self._has_ended():
            raise redis.ConnectionError("Connection closed by server.")
        return None

    def _has_ended(self) -> bool:
        try:
            return self._server() is not self.redis
        except redis.TimeoutError:
            return False
        except redis.ConnectionError:
            return True
