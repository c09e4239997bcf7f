"""Progress on a terminal, redrawn in place, or as lines now and then where there is none."""

import shutil
import sys
import time
from collections.abc import Callable, Sequence
from typing import TextIO

_REDRAW = 0.25
_REPEAT = 5.0


class Display:
    """Shows a block of lines that changes. Not thread-safe: one thread shows.

    On a terminal the block is drawn over itself, at most four times a second; elsewhere it is printed every five
    seconds. A new phase shows at once on both.
    """

    def __init__(self, output: TextIO = sys.stdout, columns: Callable[[], int] | None = None) -> None:
        """``columns`` tells the terminal's width; by default the system is asked each time."""
        self._output = output
        self._in_place = output.isatty()
        self._columns = columns or (lambda: shutil.get_terminal_size().columns)
        self._drawn = 0
        self._next = 0.0
        self._phase = ""

    def show(self, lines: Sequence[str], phase: str = "") -> None:
        """Shows the block if it is time to; a new ``phase`` is always shown."""
        now = time.monotonic()
        if now < self._next and phase == self._phase:
            return
        self._phase, self._next = phase, now + (_REDRAW if self._in_place else _REPEAT)
        if self._in_place:
            self._draw(lines)
        else:
            print(*lines, sep="\n", file=self._output, flush=True)

    def clear(self) -> None:
        """Takes the block away."""
        self._draw([])

    def _draw(self, lines: Sequence[str]) -> None:
        if not self._in_place:
            return
        columns = self._columns()
        up = f"\x1b[{self._drawn}F" if self._drawn else ""
        text = "".join(f"{line[: columns - 1]}\n" for line in lines)
        self._output.write(f"{up}\x1b[J{text}")
        self._output.flush()
        self._drawn = len(lines)
