"""``computer STEP [STEP …]``: runs several launchers, all forked from one interpreter; they end together.

Each step is a command as typed in a terminal, ``rosrun PACKAGE PROGRAM ARGUMENT …``. Python programs of this workspace
are forked, so that the steps share imported modules; other programs are executed normally. Each step leads its own
session. When a step ends or cannot be started, or on SIGINT, SIGTERM or SIGHUP, all others get SIGINT, as from Ctrl-C.

If ``PIONEER_FORK_SOCKET`` is set to a path, ``forked PROGRAM …`` can fork programs from the same interpreter.
"""

import contextlib
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence

from pioneer_launch import launcher
from pioneer_launch.fork_server import ForkServer
from pioneer_launch.forked_program import Program
from pioneer_launch.process_end import await_end
from pioneer_launch.switch import is_on
from pioneer_node.adapters.end_request import EndRequest

_LOOK = 0.1
"""Poll interval for steps that were asked to end [s]."""
_REPORTED = 0.02
"""Pause while the exit status of an ended step is not yet reported [s]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the steps; returns 0 after a requested shutdown, else the status of the ended step, at least 1."""
    steps = [shlex.split(step) for step in (sys.argv[1:] if arguments is None else arguments)]
    if not all(steps) or not steps:
        sys.stderr.write(
            "usage: computer STEP [STEP …], each STEP is a command, quoted as one word\n"
        )
        return 2
    server = launcher.shared_server() if is_on() else None
    if isinstance(server, Program):
        server.run()
    return _run(steps, server)


def _run(steps: Sequence[Sequence[str]], server: ForkServer | None) -> int:
    ending = EndRequest()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # else it was started with nohup
        numbers.append(signal.SIGHUP)
    ending.take_signals(*numbers)
    start: Callable[..., launcher.Started] = subprocess.Popen
    if server is not None:
        start = launcher.starter(server, lend=True)
    running: list[launcher.Started] = []
    ended: int | None = None
    try:
        for step in steps:
            running.append(start(launcher.resolved(step), **launcher.as_here()))
    except OSError as error:
        sys.stderr.write(f"computer: cannot run {shlex.join(step)}: {error.strerror}\n")
        ended = 127 if isinstance(error, FileNotFoundError) else 126
    while ended is None and not ending.is_set():
        await_end([one.pid for one in running], ending, _REPORTED)
        ended = next((status for one in running if (status := one.poll()) is not None), None)
    for one in running:
        if one.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                os.killpg(one.pid, signal.SIGINT)
    for one in running:
        while one.poll() is None:
            signal.sigtimedwait((), _LOOK)
    # An unrequested end is a failure whatever the status: roslaunch returns success when all its nodes have died.
    return 0 if ended is None else ended or 1
