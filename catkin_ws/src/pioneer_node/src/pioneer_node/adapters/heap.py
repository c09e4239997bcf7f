"""The C library's heap, as a process with many threads needs it."""

import ctypes

ARENAS = 2
"""Heaps of the process at most."""

_M_ARENA_MAX = -8


def limit_arenas() -> None:
    """Lets all threads of this process share few heaps; call it before there are threads.

    glibc gives each thread a heap of its own, up to eight a processor, so that threads need not wait for one another.
    In Python only one runs at a time; but a service's thread that handled a large request left its heap with holes,
    and a process whose clients come and go grew by 25 MB of them.
    """
    # Another C library has no such function, or no such heaps.
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_M_ARENA_MAX, ARENAS)
