"""Configures the C library's heap: for a process with many threads, and for one that handles large messages."""

import ctypes

ARENAS = 2
"""Maximum number of malloc arenas in the process."""

KEPT = 16 * 1024 * 1024
"""Freed memory that a process with large messages keeps [bytes]."""
LARGEST_KEPT = 8 * 1024 * 1024
"""Largest block that is taken from kept memory; larger ones go back to the kernel when they are freed [bytes]."""

_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_M_ARENA_MAX = -8


def limit_arenas() -> None:
    """Limits the number of malloc arenas that all threads share; call it before any thread starts.

    glibc creates up to eight arenas per processor so that threads do not contend for one. Python runs one thread at a
    time and does not profit. But service threads that handled large requests left fragmented arenas behind, and a
    process whose clients come and go grew by 25 MB.
    """
    _set_option(_M_ARENA_MAX, ARENAS)


def keep_freed_memory() -> None:
    """Keeps the memory of large messages for the next ones; call it before the first.

    By default, glibc returns a freed block of a megabyte to the kernel, which clears each page of the next one again.
    For a node that copies images, that was half of its CPU time.
    """
    _set_option(_M_TRIM_THRESHOLD, KEPT)
    _set_option(_M_MMAP_THRESHOLD, LARGEST_KEPT)


def _set_option(option: int, value: int) -> None:
    # Other C libraries lack this function, or these options.
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(option, value)
