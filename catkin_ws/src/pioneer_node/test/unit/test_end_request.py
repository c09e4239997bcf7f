"""The shutdown flag that a signal handler sets."""

import subprocess
import sys

from pioneer_node.adapters.end_request import EndRequest

PROGRAM = """
import signal
from pioneer_node.adapters.end_request import EndRequest

request = EndRequest()
signal.signal(signal.SIGALRM, lambda number, frame: request.set())
signal.setitimer(signal.ITIMER_REAL, 0.01, 0.0001)
while not request.wait(0.001):
    pass
for _ in range(20_000):
    request.set()
    request.wait(0.0)
signal.setitimer(signal.ITIMER_REAL, 0.0)
print("done")
"""


def test_signals_in_the_middle_of_a_wait_or_of_one_another_hang_nothing() -> None:
    """With a threading.Event, the handler used to deadlock on a lock that the interrupted main thread held."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


# The signal is delivered to a thread other than the main one, as can happen just when the main thread goes to sleep.
ASLEEP = """
import os, signal, threading, time
from pathlib import Path
from pioneer_node.adapters.end_request import EndRequest

request = EndRequest()
request.take_signals(signal.SIGINT, signal.SIGTERM)
signal.signal(signal.SIGUSR1, lambda *_: None)
nothing, _ = os.pipe()

def end():
    request.wait()
    os.write(1, b"%d" % request.number)
    os._exit(0)

def interrupt():
    while Path(f"/proc/self/task/{os.getpid()}/syscall").read_text().split()[1:2] != [hex(nothing)]:
        time.sleep(0.001)
    for number in (signal.SIGUSR1, signal.SIGTERM):
        signal.pthread_kill(threading.get_ident(), number)

for target in (end, interrupt):
    threading.Thread(target=target, daemon=True).start()
os.read(nothing, 1)
"""


def test_a_signal_is_seen_while_the_main_thread_sleeps() -> None:
    """About one in ten nodes that waited like this used not to end, because the handler was never called."""
    done = subprocess.run(
        [sys.executable, "-c", ASLEEP], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "15", "")


def test_it_stays_set() -> None:
    request = EndRequest()
    assert not request.wait(0.0)
    assert not request.is_set()
    request.set()
    assert request.is_set()
    assert request.wait(60.0)
    assert request.wait(60.0)


def test_a_wake_ends_one_wait_and_is_no_request() -> None:
    request = EndRequest()
    request.wake()
    assert not request.wait(60.0)
    assert not request.wait(0.0)
    request.wake()
    request.set()
    assert request.wait(60.0)
    assert request.wait(60.0)
