"""One thread that waits for all sockets of a relay, and for its timers."""

import heapq
import itertools
import logging
import os
import select
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from tcpros.adapters.pipe import Pipe
from tcpros.core.moderation import Moderation

BUFFER_SIZE = 256 * 1024
"""Size of the one buffer that everything is received into [bytes]: it stays within the processor's cache."""


class Handler(Protocol):
    """Receives the events of a file descriptor."""

    def ready(self, events: int) -> None:
        """Called with the epoll events that occurred."""

    def close(self, reason: str) -> None:
        """Called when `ready` raised something unforeseen."""


class Timer:
    """A call that is due later, unless it is cancelled."""

    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], object]) -> None:
        self.callback: Callable[[], object] | None = callback

    def cancel(self) -> None:
        """Takes the call back; once done or cancelled, nothing happens."""
        self.callback = None


class Reactor:
    """An epoll loop, in a thread of its own or in that which calls `run`.

    All methods but `call` and `join` belong to that thread.
    """

    def __init__(self, logger: logging.Logger) -> None:
        #: a handler may receive into it; valid until the handler returns
        self.buffer = memoryview(bytearray(BUFFER_SIZE))
        self.pipe = Pipe()  #: a handler may move bytes through it
        self.moved = 0  #: bytes of topics' messages in this round; handlers add them
        self._moderation = Moderation()
        self._logger = logger
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._order = itertools.count()
        self._calls: deque[Callable[[], object]] = deque()
        self._wake_up = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)  # type: ignore[attr-defined]
        self._epoll.register(self._wake_up, select.EPOLLIN)
        self._signals = -1
        self._running = True
        self._thread = threading.Thread(target=self.run, name="relay", daemon=True)

    def wake_on_signals(self) -> None:
        """Has every signal end the loop's rest, so that its handler runs; for a loop in the main thread.

        Python runs handlers in the main thread only, once that runs: a signal that comes to another thread, or just
        before the loop rests, would wait for the next event.
        """
        self._signals, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._epoll.register(self._signals, select.EPOLLIN)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def call(self, callback: Callable[[], object]) -> None:
        """Has `callback` called soon in the loop's thread, or never once the loop has ended; from any thread."""
        self._calls.append(callback)
        os.eventfd_write(self._wake_up, 1)  # type: ignore[attr-defined]

    def call_later(self, delay: float, callback: Callable[[], object]) -> Timer:
        """Has `callback` called in `delay` seconds."""
        timer = Timer(callback)
        heapq.heappush(self._timers, (time.monotonic() + delay, next(self._order), timer))
        return timer

    def add(self, descriptor: int, handler: Handler, events: int) -> None:
        """Tells `handler` of these events from now on."""
        self._handlers[descriptor] = handler
        self._epoll.register(descriptor, events)

    def change(self, descriptor: int, events: int) -> None:
        """Waits for other events of a descriptor."""
        self._epoll.modify(descriptor, events)

    def remove(self, descriptor: int) -> None:
        """Forgets a descriptor; before it is closed."""
        del self._handlers[descriptor]
        self._epoll.unregister(descriptor)

    def stop(self) -> None:
        """Ends the loop after what it is doing, and closes every connection."""
        self._running = False

    def join(self, timeout: float) -> None:
        """Waits for the loop's end, at most `timeout` seconds; from another thread."""
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def run(self) -> None:
        """Runs the loop in the calling thread, until it is stopped; in place of `start`."""
        while self._running:
            self.moved = 0
            for descriptor, events in self._epoll.poll(self._pause()):
                handler = self._handlers.get(descriptor)
                if descriptor == self._wake_up:
                    os.eventfd_read(self._wake_up)  # type: ignore[attr-defined]
                elif descriptor == self._signals:
                    os.read(self._signals, 4096)
                elif handler is not None:
                    try:
                        handler.ready(events)
                    except Exception:
                        self._logger.critical("a fault of ours; one connection is closed", exc_info=True)
                        handler.close("internal fault")
            self._run_timers()
            self._run_calls()
            if rest := self._moderation.rest(time.monotonic(), self.moved):
                time.sleep(rest)
        for handler in tuple(self._handlers.values()):
            self._guard(lambda h=handler: h.close(""))  # type: ignore[misc]
        self._epoll.close()
        self.pipe.close()

    def _pause(self) -> float:
        if self._calls:
            return 0.0
        return max(0.0, self._timers[0][0] - time.monotonic()) if self._timers else -1.0

    def _run_timers(self) -> None:
        while self._timers and self._timers[0][0] <= time.monotonic():
            callback = heapq.heappop(self._timers)[2].callback
            if callback is not None:
                self._guard(callback)

    def _run_calls(self) -> None:
        if not self._calls:
            return
        for _ in range(len(self._calls)):
            self._guard(self._calls.popleft())

    def _guard(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except Exception:
            self._logger.critical("a fault of ours in a callback", exc_info=True)
