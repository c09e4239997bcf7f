"""The event loop."""

import subprocess
import sys

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
