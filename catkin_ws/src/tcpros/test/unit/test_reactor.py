"""The event loop."""

import logging
import os
import select
import subprocess
import sys

from tcpros.reactor import Reactor

PROGRAM = """
import logging, os, signal, threading, time
from pathlib import Path
from tcpros.reactor import Reactor

reactor = Reactor(logging.getLogger())
reactor.wake_on_signals()
signal.signal(signal.SIGTERM, lambda *_: reactor.call(reactor.stop))

def interrupt():
    while Path(f"/proc/self/task/{os.getpid()}/syscall").read_text().split()[1:2] != [hex(reactor._epoll.fileno())]:
        time.sleep(0.001)
    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)

threading.Thread(target=interrupt, daemon=True).start()
reactor.run()
"""


def test_a_signal_that_comes_to_another_thread_is_seen_at_once() -> None:
    """Python runs the signal handler in the main thread, which was once still waiting for an event."""
    subprocess.run([sys.executable, "-c", PROGRAM], timeout=20.0, check=True)


class FullDisk(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        raise OSError(28, "No space left on device")


class Failing:
    """A handler whose every method fails."""

    def __init__(self, reactor: Reactor, descriptor: int) -> None:
        self.reactor = reactor
        self.descriptor = descriptor

    def ready(self, events: int) -> None:
        raise RuntimeError("as asked")

    def close(self, reason: str) -> None:
        self.reactor.remove(self.descriptor)
        raise RuntimeError("as asked again")


def fail() -> None:
    raise RuntimeError("as asked")


def test_failures_that_cannot_be_logged_do_not_end_the_loop() -> None:
    logger = logging.Logger("full")
    logger.addHandler(FullDisk())
    reactor = Reactor(logger)
    reader, writer = os.pipe()
    os.write(writer, b"x")
    reactor.add(reader, Failing(reactor, reader), select.EPOLLIN)
    reactor.call_later(0.0, fail)
    reactor.call(fail)
    done = list[str]()
    reactor.call_later(0.01, lambda: done.append("later"))
    reactor.call_later(0.02, reactor.stop)
    reactor.run()
    assert done == ["later"]
    os.close(reader)
    os.close(writer)


def test_a_timer_without_delay_that_repeats_keeps_no_socket_waiting() -> None:
    reactor = Reactor(logging.getLogger())
    reader, writer = os.pipe()
    os.write(writer, b"x")
    rounds = list[int]()

    class Reader:
        def ready(self, events: int) -> None:
            reactor.stop()

        def close(self, reason: str) -> None:
            reactor.remove(reader)

    def again() -> None:
        rounds.append(1)
        if len(rounds) < 1000:
            reactor.call_later(0.0, again)
        else:
            reactor.stop()

    # Added by the first callback, when the loop has already looked at its descriptors.
    reactor.call_later(0.0, lambda: (reactor.add(reader, Reader(), select.EPOLLIN), again()))
    reactor.run()
    assert len(rounds) < 3
    os.close(reader)
    os.close(writer)


def test_a_timer_cancelled_by_one_due_at_the_same_time_is_not_called() -> None:
    reactor = Reactor(logging.getLogger())
    called = list[str]()
    reactor.call_later(0.0, lambda: second.cancel())
    second = reactor.call_later(0.0, lambda: called.append("second"))
    reactor.call_later(0.01, reactor.stop)
    reactor.run()
    assert not called
