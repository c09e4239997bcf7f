"""Waits for processes to end, without polling."""

import contextlib
import os
import select
from collections.abc import Sequence

from pioneer_node.adapters.end_request import EndRequest


def await_end(
    pids: Sequence[int], bell: EndRequest, pause: float, longest: float | None = None
) -> None:
    """Waits until one of the processes has ended, or ``bell`` is set or woken.

    Args:
        pids: the processes.
        bell: also ends the wait; pending wake-ups are consumed.
        pause: wait time if a process has already ended, so that a caller in a loop does not spin [s].
        longest: time-out [s]; None for no limit.
    """
    with contextlib.ExitStack() as opened:
        handles: list[int] = []
        with contextlib.suppress(
            ProcessLookupError
        ):  # it has ended; then there is one handle fewer
            for pid in pids:
                handles.append(os.pidfd_open(pid))
                opened.callback(os.close, handles[-1])
        poll = select.poll()
        for handle in handles:
            poll.register(handle, select.POLLIN)
        if len(handles) < len(pids) or poll.poll(0):
            bell.wait(pause)
        else:
            bell.wait(longest, beside=handles)
