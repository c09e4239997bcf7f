"""Waiting for the end of processes, without looking again and again."""

import contextlib
import os
import select
from collections.abc import Sequence

from pioneer_node.adapters.end_request import EndRequest


def await_end(pids: Sequence[int], bell: EndRequest, pause: float, longest: float | None = None) -> None:
    """Waits until one of the processes has ended, or ``bell`` rings.

    Args:
        pids: the processes.
        bell: ends the wait too; its wakes are used up.
        pause: for so long it waits where one has ended before, so that a caller that looks again does not spin [s].
        longest: for so long it waits at most [s]; None for any time.
    """
    with contextlib.ExitStack() as opened:
        handles: list[int] = []
        with contextlib.suppress(ProcessLookupError):  # it has ended; then there is a handle less
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
