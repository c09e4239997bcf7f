"""A virtual screen (Xvfb), and pictures of it."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import ImageGrab

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

SCREEN_TIME = 10.0
"""Within which Xvfb must have a screen [s]."""


class HiddenScreen:
    """An X server on the first free display; a context manager that ends it.

    Args:
        size: width and height [pixels].

    Attributes:
        display: its name.
        folder: a directory of its own, removed with it.
        variables: environment variables of its clients; OpenGL is rendered in software.

    Raises:
        HarnessError: Xvfb is not installed, or has no screen in time.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._folder = TemporaryDirectory(prefix="hidden-screen-")
        self.folder = Path(self._folder.name)
        self._group = ProcessGroup()
        try:
            self.display = self._start(self.folder / "display", size)
        except BaseException:
            self.close()
            raise
        self.variables = {
            "DISPLAY": self.display,
            "XDG_RUNTIME_DIR": str(self.folder),
            "LIBGL_ALWAYS_SOFTWARE": "1",
        }

    def _start(self, output: Path, size: tuple[int, int]) -> str:
        # Xvfb prints the number of the first free display. Without -noreset it would restart, and refuse clients
        # meanwhile, whenever its last client disconnects, such as one that took a picture.
        geometry = f"{size[0]}x{size[1]}x24"
        argv = ["Xvfb", "-displayfd", "1", "-screen", "0", geometry, "-nolisten", "tcp", "-noreset"]
        self._group.start("Xvfb", argv, log=output)

        def number() -> str:
            self._group.check()
            return _number(output)

        wait_until(number, "a screen of Xvfb", SCREEN_TIME)
        return f":{_number(output)}"

    def picture(self) -> "np.ndarray[Any, np.dtype[np.uint8]]":
        """Returns the screen as it is now, shape (height, width, 3).

        Raises:
            ProcessDiedError: Xvfb has ended; with its last words.
        """
        self._group.check()
        return np.asarray(ImageGrab.grab(xdisplay=self.display).convert("RGB"))

    def close(self) -> None:
        """Stops Xvfb and removes its files."""
        self._group.stop()
        self._folder.cleanup()

    def __enter__(self) -> "HiddenScreen":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _number(path: Path) -> str:
    lines = [line for line in path.read_text(errors="replace").split() if line.isdigit()]
    return lines[-1] if lines else ""
