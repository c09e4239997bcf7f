"""An event loop and sockets in simulated time, for deterministic tests of the plumbing."""

import errno
import heapq
import itertools
import random
import select
import socket
import threading
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from tcpros.reactor import BUFFER_SIZE, Timer

SLOWEST_LOOK_UP = 20.0
"""The longest time that a name server takes [s]."""

WIDER_AFTER, WIDEST = 30_000, 4_000_000
"""A connection takes twice as many unread bytes after this many bytes, up to a limit, as TCP does."""

_IN, _OUT, _ERR = select.EPOLLIN, select.EPOLLOUT, select.EPOLLERR


class SimulatedReactor:
    """Replaces `tcpros.reactor.Reactor`: ready sockets are handled in random order, and time jumps to the next event.

    Args:
        drawn: source of all random choices.
    """

    def __init__(self, drawn: random.Random) -> None:
        self.buffer = memoryview(bytearray(BUFFER_SIZE))
        self.pipe = SimpleNamespace(is_usable=False)
        self.moved = 0
        self.faults = SimpleNamespace(take=self._fail)
        self.now = 1000.0  #: simulated time [s]
        self.drawn = drawn
        self.failures: list[BaseException] = []  #: exceptions of handlers and callbacks
        self.sockets: dict[int, SimulatedSocket] = {}  #: all open sockets, by descriptor
        self._handlers: dict[int, tuple[Any, int]] = {}
        self._touched: set[int] = set()  # sockets that may be ready
        self._arrivals: list[tuple[float, int]] = []  # when sockets become so
        self._timers: list[tuple[float, int, Timer]] = []
        self._order = itertools.count()
        self._calls: deque[Callable[[], object]] = deque()

    def _fail(self, error: BaseException) -> None:
        self.failures.append(error)

    def call(self, callback: Callable[[], object]) -> None:
        """Schedules a call."""
        self._calls.append(callback)

    def call_later(self, delay: float, callback: Callable[[], object]) -> Timer:
        """Schedules a call in `delay` seconds."""
        timer = Timer(callback)
        heapq.heappush(self._timers, (self.now + max(0.0, delay), next(self._order), timer))
        return timer

    def add(self, descriptor: int, handler: Any, events: int) -> None:
        """Registers a handler."""
        assert descriptor not in self._handlers
        self._handlers[descriptor] = handler, events
        self.touch(descriptor)

    def change(self, descriptor: int, events: int) -> None:
        """Changes the events to wait for."""
        self._handlers[descriptor] = self._handlers[descriptor][0], events
        self.touch(descriptor)

    def touch(self, descriptor: int, when: float = 0.0) -> None:
        """Called when a socket has changed, or will at this time, so that it may be ready."""
        if when <= self.now:
            self._touched.add(descriptor)
        else:
            heapq.heappush(self._arrivals, (when, descriptor))

    def remove(self, descriptor: int) -> None:
        """Removes a handler."""
        del self._handlers[descriptor]

    def run(self, seconds: float, done: Callable[[], bool] = lambda: False) -> bool:
        """Runs for this long, or until `done`; returns whether it is done."""
        end = self.now + seconds
        while self.now < end and not done():
            if not self._round():
                self._advance(end)
        return done()

    def is_idle(self) -> bool:
        """Returns whether no socket is open and nothing is to be called."""
        return not self.left()

    def left(self) -> list[object]:
        """Returns the open sockets, and the calls that are to be made."""
        timers = [timer.callback for _, _, timer in self._timers if timer.callback is not None]
        return [*self.sockets, *timers, *self._calls]

    def _round(self) -> bool:
        """Handles what is ready now; returns whether there was anything."""
        while self._arrivals and self._arrivals[0][0] <= self.now:
            self._touched.add(heapq.heappop(self._arrivals)[1])
        ready = []
        for descriptor in sorted(self._touched):
            handler, wanted = self._handlers.get(descriptor, (None, 0))
            found = self.sockets[descriptor].events() & (wanted | _ERR) if handler else 0
            if found:
                ready.append((descriptor, found))
            else:
                self._touched.discard(descriptor)
        self.drawn.shuffle(ready)
        # As epoll reports a limited number of events, some sockets wait for the next round.
        for descriptor, found in ready[: self.drawn.randint(1, 8)]:
            if descriptor not in self._handlers:
                continue
            handler = self._handlers[descriptor][0]
            self._guard(lambda h=handler, f=found: h.ready(f))  # type: ignore[misc]
        due = []
        while self._timers and self._timers[0][0] <= self.now:
            due.append(heapq.heappop(self._timers)[2])
        for timer in due:
            if timer.callback is not None:
                self._guard(timer.callback)
        calls, self._calls = self._calls, deque()
        for call in calls:
            self._guard(call)
        return bool(ready or due or calls)

    def _advance(self, end: float) -> None:
        """Moves the time to the next timer or arrival."""
        times = [end]
        if self._timers:
            times.append(self._timers[0][0])
        if self._arrivals:
            times.append(self._arrivals[0][0])
        # At least a little, against rounding.
        self.now = max(self.now + 1e-6, min(times))

    def _guard(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except Exception as error:  # noqa: BLE001 - reported as a failure of the simulation
            self.failures.append(error)


class SimulatedSocket:
    """A TCP socket, listening or connected. Data arrive late, in pieces, and block when too many are unread."""

    def __init__(self, network: "Network") -> None:
        self._network = network
        self._reactor = network.reactor
        self._descriptor = next(network.descriptors)
        self._reactor.sockets[self._descriptor] = self
        self._port = 0
        self._backlog: list[SimulatedSocket] | None = None
        self.peer: SimulatedSocket | None = None
        self._connecting_until = -1.0  # the handshake's end, while it is not reported
        self._error = 0
        self._reset_at = float("inf")
        self._arriving: deque[tuple[float, bytes]] = deque()
        self._unread = 0  # bytes on their way to us or unread
        self._last_arrival = 0.0
        self._ended_at = float("inf")  # when the peer's end arrives
        # Together, at least 4 MB/s.
        self._capacity, self._latency = network.drawn.choice(
            ((1500, 0.0), (1500, 0.0001), (20_000, 0.002), (200_000, 0.05), (4_000_000, 0.05))
        )
        self._until_wider = WIDER_AFTER
        self.is_closed = False

    # What the modules under test call

    def setblocking(self, _flag: bool) -> None:
        """Does nothing."""

    def setsockopt(self, *_: object) -> None:
        """Does nothing."""

    def getsockopt(self, _level: int, option: int, size: int = 0) -> Any:
        """Returns the pending error; no information otherwise."""
        if option == socket.SO_ERROR:
            self._connecting_until = -1.0
            return self._error
        return b"" if size else 0

    def fileno(self) -> int:
        """Returns the descriptor; -1 once closed."""
        return -1 if self.is_closed else self._descriptor

    def bind(self, _address: tuple[str, int]) -> None:
        """Takes a port."""
        self._port = next(self._network.ports)
        self._network.listeners[self._port] = self

    def listen(self, _backlog: int) -> None:
        """Starts to listen."""
        self._backlog = []
        self._reactor.touch(self._descriptor)

    def getsockname(self) -> tuple[str, int]:
        """Returns the address."""
        return "127.0.0.1", self._port

    def connect(self, address: tuple[str, int]) -> None:
        """Begins to connect."""
        delay = self._network.drawn.choice((0.0, 0.001, 0.2))
        self._connecting_until = self._reactor.now + delay
        self._reactor.touch(self._descriptor, self._connecting_until)
        target = self._network.listeners.get(address[1])
        if target is None or self._network.refuses():
            self._error = errno.ECONNREFUSED
        else:
            other = SimulatedSocket(self._network)
            self.peer, other.peer = other, self
            assert target._backlog is not None
            target._backlog.append(other)
            self._reactor.touch(target._descriptor)
        raise BlockingIOError

    def accept(self) -> tuple["SimulatedSocket", tuple[str, int]]:
        """Returns a new connection."""
        if not self._backlog:
            raise BlockingIOError
        if self._network.lacks_descriptors():
            raise OSError(errno.EMFILE, "Too many open files")
        return self._backlog.pop(0), ("127.0.0.1", 1)

    def send(self, data: Any, _flags: int = 0) -> int:
        """Sends a part of the data."""
        return self.sendmsg([data])

    def sendmsg(self, buffers: list[Any]) -> int:
        """Sends a part of the data."""
        self._check()
        peer = self.peer
        if peer is None or peer.is_closed:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        room = self._capacity - peer._unread
        if room <= 0:
            raise BlockingIOError
        if self._network.drawn.random() < 0.2:
            room = self._network.drawn.randint(1, room)
        sent = 0
        for buffer in buffers:
            part = bytes(buffer[: room - sent])
            if part:
                peer._take(part, self._latency)
                sent += len(part)
            if sent == room:
                break
        self._until_wider -= sent
        if self._until_wider <= 0:
            self._until_wider = WIDER_AFTER
            self._capacity = min(2 * self._capacity, WIDEST)
        return sent

    def recv_into(self, buffer: memoryview) -> int:
        """Receives a part of what has arrived."""
        self._check()
        now = self._reactor.now
        if self._arriving and self._arriving[0][0] <= now:
            room = len(buffer)
            if self._network.drawn.random() < 0.2:
                room = self._network.drawn.randint(1, min(room, len(self._arriving[0][1])))
            count = 0
            while count < room and self._arriving and self._arriving[0][0] <= now:
                when, data = self._arriving.popleft()
                part = data[: room - count]
                buffer[count : count + len(part)] = part
                count += len(part)
                if len(part) < len(data):
                    self._arriving.appendleft((when, data[len(part) :]))
            self._unread -= count
            if self.peer is not None:
                self._reactor.touch(self.peer._descriptor)
            return count
        if self._ended_at <= now:
            return 0
        raise BlockingIOError

    def close(self) -> None:
        """Ends the connection; its peer learns of it behind the data."""
        if self.is_closed:
            return
        self.is_closed = True
        del self._reactor.sockets[self._descriptor]
        if self._backlog is not None:
            self._network.listeners.pop(self._port, None)
            for waiting in self._backlog:
                waiting.reset()
                waiting.close()
        if self.peer is not None:
            self.peer._ended_at = max(self.peer._last_arrival, self._reactor.now + self._latency)
            self._reactor.touch(self.peer._descriptor)
            self._reactor.touch(self.peer._descriptor, self.peer._ended_at)

    # What the simulation calls

    def events(self) -> int:
        """Returns the events of epoll that are due."""
        now = self._reactor.now
        if self._connecting_until >= 0:
            if now < self._connecting_until:
                return 0
            return _OUT | (_ERR if self._error else 0)
        if self._reset_at <= now:
            return _IN | _OUT | _ERR
        found = 0
        if self._backlog or (self._arriving and self._arriving[0][0] <= now):
            found |= _IN
        if self._ended_at <= now and not self._arriving:
            found |= _IN
        peer = self.peer
        if peer is not None and (peer.is_closed or peer._unread < self._capacity):
            found |= _OUT
        return found

    def reset(self) -> None:
        """Breaks the connection for both ends."""
        for one in (self, self.peer):
            if one is not None:
                one._reset_at = self._reactor.now
                self._reactor.touch(one._descriptor)

    def _take(self, data: bytes, latency: float) -> None:
        self._last_arrival = max(self._last_arrival, self._reactor.now + latency)
        self._arriving.append((self._last_arrival, data))
        self._reactor.touch(self._descriptor, self._last_arrival)
        self._unread += len(data)

    def _check(self) -> None:
        if self._reset_at <= self._reactor.now:
            raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")


class Network:
    """All sockets, with their faults.

    Args:
        reactor: the loop.
    """

    def __init__(self, reactor: SimulatedReactor) -> None:
        self.reactor = reactor
        self.drawn = reactor.drawn
        self.listeners: dict[int, SimulatedSocket] = {}
        self.ports = itertools.count(20_000)
        self.descriptors = itertools.count(10)
        #: whether connections are refused, names fail to resolve, descriptors and threads are missing, now and then
        self.is_faulty = True
        self.refused_threads = 0  #: how many threads could not be started

    def refuses(self) -> bool:
        """Returns whether the next connection is refused."""
        return self.is_faulty and self.drawn.random() < 0.1

    def lacks_descriptors(self) -> bool:
        """Returns whether the next socket cannot be opened."""
        return self.is_faulty and self.drawn.random() < 0.02

    def break_one(self) -> None:
        """Breaks a connection."""
        connected = [one for one in self.reactor.sockets.values() if one.peer is not None]
        if connected:
            self.drawn.choice(connected).reset()

    def socket_module(self, is_scarce: bool = False) -> Any:
        """Returns a replacement of the module `socket`; if it `is_scarce`, there is not always a descriptor."""

        def opened(*_: object) -> SimulatedSocket:
            if is_scarce and self.lacks_descriptors():
                raise OSError(errno.EMFILE, "Too many open files")
            return SimulatedSocket(self)

        names = {name: getattr(socket, name) for name in dir(socket) if not name.startswith("__")}
        names["socket"] = opened
        names["getaddrinfo"] = self._resolved
        return SimpleNamespace(**names)

    def threading_module(self) -> Any:
        """Returns a replacement of the module `threading` whose threads run later, in the loop, at once."""
        network = self

        class SimulatedThread:
            def __init__(
                self, target: Callable[..., object], args: tuple[Any, ...] = (), **_: Any
            ) -> None:
                self._work = lambda: target(*args)

            def start(self) -> None:
                if network.is_faulty and network.drawn.random() < 0.02:
                    network.refused_threads += 1
                    raise RuntimeError("can't start new thread")
                delays = (
                    (0.0, 0.01, 1.0, SLOWEST_LOOK_UP) if network.is_faulty else (0.0, 0.01, 1.0)
                )
                network.reactor.call_later(network.drawn.choice(delays), self._work)

        names = {name: getattr(threading, name) for name in dir(threading) if name[0] != "_"}
        names["Thread"] = SimulatedThread
        return SimpleNamespace(**names)

    def time_module(self) -> Any:
        """Returns a replacement of the module `time`."""
        return SimpleNamespace(monotonic=lambda: self.reactor.now, time=lambda: self.reactor.now)

    def _resolved(self, host: str, *_: object) -> list[Any]:
        if host.startswith("host") and int(host[4:]) % 4 == 0:
            raise socket.gaierror(-2, "Name or service not known")
        if self.refuses():
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return [(2, 1, 6, "", ("127.0.0.1", 0))]
