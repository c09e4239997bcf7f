"""Shows progress: redrawn in place on a terminal, as periodic lines elsewhere."""

import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from typing import TextIO

from pioneer_fleet.printable import printable

_REDRAW = 0.25
_REPEAT = 5.0
_COLOUR = re.compile("(\x1b\\[(?:0|31|32)m)")
"""What ``Display.painted`` adds; all other control characters are escaped."""


class Display:
    """Shows a changing block of lines. Not thread-safe.

    Texts come from other programs, too: characters that control a terminal are escaped.

    On a terminal the block is redrawn in place, at most four times a second; elsewhere it is printed every 5 s. A new
    phase is shown at once on both.
    """

    def __init__(
        self, output: TextIO = sys.stdout, columns: Callable[[], int] | None = None
    ) -> None:
        """``columns`` returns the terminal's width; by default it is queried from the system."""
        self._output = output
        self.in_place = output.isatty()  #: whether the output is a terminal
        self._columns = columns or (lambda: shutil.get_terminal_size().columns)
        self._drawn = 0
        self._next = 0.0
        self._phase = ""

    def show(self, lines: Callable[[], Sequence[str]], phase: str = "") -> None:
        """Shows the block that ``lines`` returns, if it is due; always if ``phase`` is new."""
        now = time.monotonic()
        if now < self._next and phase == self._phase:
            return
        self._phase, self._next = phase, now + (_REDRAW if self.in_place else _REPEAT)
        if self.in_place:
            self._draw(list(map(_shown, lines())))
        else:
            print(*map(_shown, lines()), sep="\n", file=self._output, flush=True)

    def say(self, line: str) -> None:
        """Prints a permanent line, or several, above the block."""
        self.clear()
        print(_shown(line, "\n"), file=self._output, flush=True)

    def clear(self) -> None:
        """Removes the block."""
        self._draw([])

    def painted(self, text: str, good: bool) -> str:
        """Returns ``text`` in green or red; unchanged if there is no terminal or NO_COLOR is set."""
        if not self.in_place or os.environ.get("NO_COLOR"):
            return text
        return f"\x1b[{32 if good else 31}m{text}\x1b[0m"

    def _draw(self, lines: Sequence[str]) -> None:
        if not self.in_place:
            return
        columns = self._columns()
        up = f"\x1b[{self._drawn}F" if self._drawn else ""
        text = "".join(f"{line[: columns - 1]}\n" for line in lines)
        self._output.write(f"{up}\x1b[J{text}")
        self._output.flush()
        self._drawn = len(lines)


def _shown(line: str, kept: str = "") -> str:
    """Returns a line without control characters, but for our colours and those in ``kept``."""
    parts = _COLOUR.split(line)
    return "".join(part if _COLOUR.fullmatch(part) else printable(part, kept) for part in parts)
