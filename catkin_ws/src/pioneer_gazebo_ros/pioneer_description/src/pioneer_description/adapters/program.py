"""Subprocesses bound to the duration of a block."""

import contextlib
import signal
import subprocess
from collections.abc import Iterator, Sequence
from typing import Any

_GRACE = 3.0
"""Time a program has to end after SIGINT before it is killed [s]."""
# A program must not outlive this process, even if this process is killed. A shell starts background jobs with SIGINT
# ignored, which a program would inherit.
_PREFIX = ("env", "--default-signal=INT", "setpriv", "--pdeathsig", "TERM", "--")


@contextlib.contextmanager
def running(argv: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[bytes]"]:
    """Runs a program in its own session and ends it with the block; ``options`` are passed to ``Popen``."""
    program = subprocess.Popen([*_PREFIX, *argv], start_new_session=True, stdin=subprocess.DEVNULL, **options)
    try:
        yield program
    finally:
        program.send_signal(signal.SIGINT)
        try:
            program.wait(_GRACE)
        except subprocess.TimeoutExpired:
            program.kill()
            program.wait()
