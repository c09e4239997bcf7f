"""Programs that run as long as a block does."""

import contextlib
import signal
import subprocess
from collections.abc import Iterator, Sequence
from typing import Any

_GRACE = 3.0
"""For a program to end after SIGINT [s]; then it is killed."""
# A program must not outlive this process, even one that was killed; and a shell starts background jobs with SIGINT
# ignored, which a program would inherit.
_PREFIX = ("env", "--default-signal=INT", "setpriv", "--pdeathsig", "TERM", "--")


@contextlib.contextmanager
def running(argv: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[bytes]"]:
    """Runs a program in a session of its own and ends it with the block; ``options`` are those of ``Popen``."""
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
