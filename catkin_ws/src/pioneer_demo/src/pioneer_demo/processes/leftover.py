"""Processes that a killed command has left: the next command waits for their end before it starts its own.

The kernel sends SIGTERM to a fleet's processes when their command is killed; until they have ended, they hold ports,
publish to a master that the next fleet may find under its own port, and write files in the same folder.
"""

import contextlib
import os
import signal
import time
from collections.abc import Callable

from pioneer_harness.proc import ProcessState, process_state, process_states, variable

VARIABLE = "PIONEER_FLEET_COMMAND"
"""Environment variable of all of a fleet's processes: which command has started them."""
_GRACE = 20.0
"""Time for their end, after which they are killed [s]: roslaunch gives each node up to 15 s."""
_KILLED = 10.0
_POLL = 0.05


def mark() -> str:
    """Returns the value of ``VARIABLE`` for processes that this process starts."""
    state = process_state(os.getpid())
    assert state is not None, "this process is running"
    return _mark(state)


def leftovers() -> list[int]:
    """Returns the processes of commands that no longer exist: of this user, or of all users for root."""
    states, namespace = process_states(), _namespace()
    living = {_mark(state) for state in states.values() if state.alive}
    found = []
    for state in states.values():
        value = variable(state.pid, VARIABLE) if state.alive else ""
        # Process ids of another namespace, such as a container's, mean nothing here.
        if value.startswith(namespace) and value not in living:
            found.append(state.pid)
    return found


def await_leftovers(
    say: Callable[[str], None],
    check: Callable[[], None],
    grace: float = _GRACE,
) -> None:
    """Waits until no process of a killed command is left; kills those that do not end.

    Args:
        say: prints what is awaited; called only if there is something to wait for.
        check: polled; raises an exception if the user wants this command to end.
        grace: time before they are killed [s].
    """
    began = time.monotonic()
    said = False
    while left := leftovers():
        check()
        waited = time.monotonic() - began
        if not said:
            say(f"Waiting for {len(left)} processes of a killed command to end …")
            said = True
        if waited > grace + _KILLED:
            say(f"{len(left)} processes of a killed command do not end: {left}")
            return
        if waited > grace:
            _kill(left)
        time.sleep(_POLL)


def _kill(pids: list[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)


def _namespace() -> str:
    return os.readlink("/proc/self/ns/pid") + ":"


def _mark(state: ProcessState) -> str:
    return f"{_namespace()}{state.pid}:{state.started}"
