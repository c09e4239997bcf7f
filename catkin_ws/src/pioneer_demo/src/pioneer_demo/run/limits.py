"""Checks the limits of the shell (``ulimit``) before a fleet starts: without room, programs fail in many ways."""

import resource

from pioneer_demo.error import DemoError

FILES = 256
"""Files that a program of a fleet may have to open."""
ADDRESS_SPACE = 4 << 30
"""Virtual memory that a program of a fleet may map [bytes]; few of these pages are used."""


def check_limits() -> None:
    """Raises DemoError if the programs of a fleet would run out of files or address space."""
    _, files = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files != resource.RLIM_INFINITY and files < FILES:
        raise DemoError(
            f"too few open files are allowed: ulimit -n is {files}, a fleet needs {FILES} in each program"
        )
    space, _ = resource.getrlimit(resource.RLIMIT_AS)
    if space != resource.RLIM_INFINITY and space < ADDRESS_SPACE:
        raise DemoError(
            f"too little address space is allowed: ulimit -v is {space >> 10} kB, "
            f"a fleet needs {ADDRESS_SPACE >> 10} kB in each program"
        )
