"""An epoll event loop: one thread serves all sockets and timers of a relay."""

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

from tcpros.loop_faults import LoopFaults
from tcpros.moderation import Moderation
from tcpros.pipe import Pipe

BUFFER_SIZE = 256 * 1024
"""Size of the single receive buffer [bytes]: small enough to stay in the CPU cache."""


class Handler(Protocol):
    """Receives the events of a file descriptor."""

    def ready(self, events: int) -> None:
        """Called with the epoll events that occurred."""

    def close(self, reason: str) -> None:
        """Called when `ready` raised an unexpected exception."""


class Timer:
    """A scheduled call, which can be cancelled."""

    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], object]) -> None:
        self.callback: Callable[[], object] | None = callback

    def cancel(self) -> None:
        """Cancels the call; does nothing if it was made or cancelled already."""
        self.callback = None


class Reactor:
    """An epoll loop in its own thread, or in the thread that calls `run`.

    All methods except `call` and `join` must be called in that thread.
    """

    def __init__(self, logger: logging.Logger) -> None:
        #: receive buffer for handlers; its content is valid until the handler returns
        self.buffer = memoryview(bytearray(BUFFER_SIZE))
        self.pipe = Pipe()  #: for handlers that splice
        self.moved = 0  #: bytes of topic messages in this round; handlers add to it
        self._moderation = Moderation()
        self.faults = LoopFaults(
            logger, "the event loop"
        )  #: takes unexpected exceptions of handlers
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
        """Makes every signal wake the loop so that the signal's handler runs; for a loop in the main thread.

        Python runs signal handlers only in the main thread, when it executes. A signal that arrives in another thread,
        or just before the loop blocks, would otherwise be handled only after the next event.
        """
        self._signals, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._epoll.register(self._signals, select.EPOLLIN)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def call(self, callback: Callable[[], object]) -> None:
        """Schedules `callback` in the loop's thread; callable from any thread. Does nothing once the loop has ended."""
        self._calls.append(callback)
        os.eventfd_write(self._wake_up, 1)  # type: ignore[attr-defined]

    def call_later(self, delay: float, callback: Callable[[], object]) -> Timer:
        """Schedules `callback` in `delay` seconds."""
        timer = Timer(callback)
        heapq.heappush(self._timers, (time.monotonic() + delay, next(self._order), timer))
        return timer

    def add(self, descriptor: int, handler: Handler, events: int) -> None:
        """Registers `handler` for these events of a descriptor."""
        self._handlers[descriptor] = handler
        self._epoll.register(descriptor, events)

    def change(self, descriptor: int, events: int) -> None:
        """Changes the events to wait for on a descriptor."""
        self._epoll.modify(descriptor, events)

    def remove(self, descriptor: int) -> None:
        """Removes a descriptor; must be called before it is closed."""
        del self._handlers[descriptor]
        self._epoll.unregister(descriptor)

    def stop(self) -> None:
        """Stops the loop after the current round and closes every connection."""
        self._running = False

    def join(self, timeout: float) -> None:
        """Waits up to `timeout` seconds for the loop to end. Does nothing in the loop's own thread."""
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def run(self) -> None:
        """Runs the loop in the calling thread until it is stopped; use instead of `start`."""
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
                    except Exception as error:  # noqa: BLE001 - the outermost; it is logged
                        self.faults.take(error)
                        self._guard(lambda h=handler: h.close("internal fault"))  # type: ignore[misc]
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
        now = time.monotonic()
        if not self._timers or self._timers[0][0] > now:
            return
        # Only those due now: a callback that schedules itself without delay must not keep the sockets waiting.
        due: list[Timer] = []
        while self._timers and self._timers[0][0] <= now:
            due.append(heapq.heappop(self._timers)[2])
        for timer in due:
            if timer.callback is not None:
                self._guard(timer.callback)

    def _run_calls(self) -> None:
        if not self._calls:
            return
        for _ in range(len(self._calls)):
            self._guard(self._calls.popleft())

    def _guard(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except Exception as error:  # noqa: BLE001 - the outermost; it is logged
            self.faults.take(error)
