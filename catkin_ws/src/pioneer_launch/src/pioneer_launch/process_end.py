"""Waits for processes to end, without polling."""

import contextlib
import os
import select
from collections.abc import Sequence

from pioneer_node.adapters.end_request import EndRequest

_UNSEEN = 0.1
"""Wait time while processes cannot be waited for [s]: the caller polls them."""


def await_end(
    pids: Sequence[int], bell: EndRequest, pause: float, longest: float | None = None
) -> None:
    """Waits until one of the processes has ended, or ``bell`` is set or woken; briefly if no descriptor is left.

    Args:
        pids: the processes.
        bell: also ends the wait; pending wake-ups are consumed.
        pause: wait time if a process has already ended, so that a caller in a loop does not spin [s].
        longest: time-out [s]; None for no limit.
    """
    with contextlib.ExitStack() as opened:
        handles: list[int] = []
        try:
            for pid in pids:
                handles.append(os.pidfd_open(pid))
                opened.callback(os.close, handles[-1])
        except ProcessLookupError:
            pass  # it has ended; then there is one handle fewer
        except OSError:  # no descriptor is left
            pause = max(pause, _UNSEEN)
        poll = select.poll()
        for handle in handles:
            poll.register(handle, select.POLLIN)
        if len(handles) < len(pids) or poll.poll(0):
            bell.wait(pause)
        else:
            bell.wait(longest, beside=handles)
