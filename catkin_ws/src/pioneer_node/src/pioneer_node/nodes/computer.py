"""``computer STEP [STEP …]``: several launchers of one computer, all forked from one interpreter; they end together.

Each step is a command as in a terminal, ``rosrun PACKAGE PROGRAM ARGUMENT …``. A Python program of this workspace is
forked, so that the steps share what they have imported; any other is started as it is. Each leads a session of its
own. When a step ends, or SIGINT or SIGTERM asks for the end, the others get SIGINT, as from Ctrl-C.

With ``PIONEER_FORK_SOCKET`` set to a path, ``forked PROGRAM …`` has programs forked from the same interpreter.
"""

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.fork_client import SWITCH
from pioneer_node.adapters.fork_server import ForkServer
from pioneer_node.adapters.forked_program import Program
from pioneer_node.adapters.process_end import await_end
from pioneer_node.nodes import launcher

_LOOK = 0.1
"""How often steps that were asked to end are looked at [s]."""
_REPORTED = 0.02
"""Pause where a step has ended and its exit status has not been reported yet [s]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the steps; returns 0 when it was asked to end, else the status of the step that ended, 1 at least."""
    steps = [shlex.split(step) for step in (sys.argv[1:] if arguments is None else arguments)]
    if not all(steps) or not steps:
        sys.stderr.write("usage: computer STEP [STEP …], each a command in one word\n")
        return 2
    server = None if os.environ.get(SWITCH) == "0" else launcher.shared_server()
    if isinstance(server, Program):
        server.run()
    return _run(steps, server)


def _run(steps: Sequence[Sequence[str]], server: ForkServer | None) -> int:
    ending = EndRequest()
    ending.take_signals(signal.SIGINT, signal.SIGTERM)
    start: Callable[..., launcher.Started] = subprocess.Popen
    if server is not None:
        start = launcher.starter(server, lend=True)
    running: list[launcher.Started] = [start(launcher.resolved(step), **launcher.as_here()) for step in steps]
    ended = None
    while ended is None and not ending.is_set():
        await_end([one.pid for one in running], ending, _REPORTED)
        ended = next((status for one in running if (status := one.poll()) is not None), None)
    for one in running:
        if one.poll() is None:
            os.killpg(one.pid, signal.SIGINT)
    for one in running:
        while one.poll() is None:
            signal.sigtimedwait((), _LOOK)
    # Not asked to, so a failure, whatever the step says: roslaunch calls it a success when all its nodes have died.
    return 0 if ended is None else ended or 1
