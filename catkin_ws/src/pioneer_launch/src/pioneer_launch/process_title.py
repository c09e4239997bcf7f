"""Sets what ``ps`` and ``/proc`` show for a process that was forked but not executed."""

import ctypes
import mmap
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

_PR_SET_NAME, _PR_SET_MM, _PR_SET_MM_MAP = 15, 35, 14
_NAME = 15
"""Maximum length of a process name in the kernel [bytes]."""
_FIELDS = ("start_code", "end_code", "start_data", "end_data", "start_brk", "brk", "start_stack")
_OWN = ("arg_start", "arg_end", "env_start", "env_end")
# Field indices in /proc/self/stat, counted after the name in brackets; see proc_pid_stat(5).
_PLACES = {
    "start_code": 23,
    "end_code": 24,
    "start_stack": 25,
    "start_data": 42,
    "end_data": 43,
    "start_brk": 44,
}
_libc = ctypes.CDLL(None, use_errno=True)
_libc.sbrk.restype = ctypes.c_void_p
_kept: list[mmap.mmap] = []


class _MemoryMap(ctypes.Structure):
    """The kernel's ``struct prctl_mm_map``."""

    _fields_ = (
        *((name, ctypes.c_uint64) for name in (*_FIELDS, *_OWN)),
        ("auxv", ctypes.c_void_p),
        ("auxv_size", ctypes.c_uint32),
        ("exe_fd", ctypes.c_uint32),
    )


def show(arguments: Sequence[str], environment: Mapping[str, str], name: str) -> bool:
    """Sets this process's visible command line, environment and name as if it had been executed with them.

    Returns:
        False if the kernel does not support it (built without CONFIG_CHECKPOINT_RESTORE); the process then keeps the
        command line that it was forked with.
    """
    _libc.prctl(_PR_SET_NAME, os.fsencode(name)[:_NAME], 0, 0, 0)
    words = b"".join(os.fsencode(word) + b"\0" for word in arguments)
    variables = b"".join(
        os.fsencode(f"{key}={value}") + b"\0" for key, value in environment.items()
    )
    text = mmap.mmap(-1, len(words) + len(variables) + 1, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    text.write(words + variables)
    start = ctypes.addressof(ctypes.c_char.from_buffer(text))
    stat = Path("/proc/self/stat").read_text()
    numbers = stat[stat.rindex(")") + 2 :].split()
    memory = _MemoryMap(exe_fd=0xFFFFFFFF)
    for field, place in _PLACES.items():
        setattr(memory, field, int(numbers[place]))
    memory.arg_start, memory.arg_end = start, start + len(words)
    memory.env_start, memory.env_end = memory.arg_end, memory.arg_end + len(variables)
    size = ctypes.sizeof(memory)
    memory.brk = _libc.sbrk(0)  # last: any allocation moves it
    if _libc.prctl(_PR_SET_MM, _PR_SET_MM_MAP, ctypes.byref(memory), size, 0):
        return False
    _kept.append(text)
    return True
