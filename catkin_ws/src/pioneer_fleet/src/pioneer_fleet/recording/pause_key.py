"""The space bar pauses and continues a replay."""
# ruff: noqa: T201 - a command talks to people on standard output

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable

_READ = 64


class PauseKey:
    """Calls a function at each press of the space bar, if standard input is a terminal. A context manager.

    Threads: one, which reads the terminal.
    """

    def __init__(self, toggle: Callable[[], None]) -> None:
        self._toggle = toggle
        self._keyboard = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else -1
        self._before = termios.tcgetattr(self._keyboard) if _is_ours(self._keyboard) else None
        self._end = self._ending = -1
        self._thread = threading.Thread(target=self._read, name="keys", daemon=True)

    def restore(self) -> None:
        """Gives the terminal back as it was; safe at any time."""
        if self._before is not None:
            termios.tcsetattr(self._keyboard, termios.TCSANOW, self._before)

    def __enter__(self) -> "PauseKey":
        if self._before is not None:
            # Readable once the replay has ended.
            self._end, self._ending = os.pipe()
            tty.setcbreak(self._keyboard, termios.TCSADRAIN)
            self._thread.start()
            print("The space bar pauses and continues.", flush=True)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            os.write(self._ending, b"x")
            self._thread.join()
            self.restore()
            os.close(self._end)
            os.close(self._ending)

    def _read(self) -> None:
        while True:
            readable, _, _ = select.select([self._keyboard, self._end], [], [])
            if self._end in readable:
                return
            try:
                keys = os.read(self._keyboard, _READ)
            except OSError:
                return  # the terminal was closed
            if not keys:
                return
            for _ in range(keys.count(b" ")):
                self._toggle()


def _is_ours(keyboard: int) -> bool:
    """Returns whether this process may read a terminal: in the background of a shell it would be stopped."""
    if keyboard < 0:
        return False
    try:
        return os.tcgetpgrp(keyboard) == os.getpgrp()
    except OSError:
        return True  # it is no shell's terminal
