"""RViz on a screen that nobody sees (Xvfb), and pictures of that screen."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from PIL import Image, ImageGrab

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

SCREEN_TIME = 10.0
"""Within which Xvfb must have a screen [s]."""


class RvizError(RuntimeError):
    """RViz or its screen cannot be started; the text says what to do."""


class HiddenRviz:
    """RViz, full screen, as the node ``/rviz``; a context manager that ends it.

    Args:
        config: the RViz configuration.
        size: of the screen, width and height [pixels].

    Raises:
        RvizError: Xvfb or rviz is not installed.
        HarnessError: a process ended, or Xvfb has no screen in time.
    """

    def __init__(self, config: Mapping[str, Any], size: tuple[int, int]) -> None:
        for program, package in (("Xvfb", "xvfb"), ("rviz", "rviz")):
            if shutil.which(program) is None:
                raise RvizError(f"{program} is not installed: apt install {package}")
        self._folder = TemporaryDirectory(prefix="rviz-snapshot-")
        self._screen, self._rviz = ProcessGroup(), ProcessGroup()
        try:
            self.display = self._start(Path(self._folder.name), config, size)
        except BaseException:
            self.close()
            raise

    def _start(self, folder: Path, config: Mapping[str, Any], size: tuple[int, int]) -> str:
        (folder / "shown.rviz").write_text(yaml.safe_dump(dict(config), allow_unicode=True))
        screen = folder / "display"
        # The number of the first free display goes to standard output.
        geometry = f"{size[0]}x{size[1]}x24"
        argv = ["Xvfb", "-displayfd", "1", "-screen", "0", geometry, "-nolisten", "tcp"]
        self._screen.start("Xvfb", argv, log=screen)
        wait_until(lambda: self._screen.check() or _number(screen), "a screen of Xvfb", SCREEN_TIME)
        display = f":{_number(screen)}"
        environment = {**os.environ, "DISPLAY": display, "XDG_RUNTIME_DIR": str(folder), "LIBGL_ALWAYS_SOFTWARE": "1"}
        argv = ["rviz", "--fullscreen", "-d", str(folder / "shown.rviz"), "__name:=rviz"]
        self._rviz.start("rviz", argv, environment, folder / "rviz.log")
        return display

    def picture(self) -> "np.ndarray[Any, np.dtype[np.uint8]]":
        """Returns the screen as it is now, shape (height, width, 3).

        Raises:
            ProcessDiedError: RViz or its screen has ended; with their last words.
        """
        self._screen.check()
        self._rviz.check()
        return np.asarray(ImageGrab.grab(xdisplay=self.display).convert("RGB"))

    def close(self) -> None:
        """Ends both, RViz first: without its screen it would die without telling the master."""
        self._rviz.stop()
        self._screen.stop()
        self._folder.cleanup()

    def __enter__(self) -> "HiddenRviz":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def save(picture: "np.ndarray[Any, np.dtype[np.uint8]]", path: Path) -> None:
    """Writes a picture as PNG; OSError where that is not possible."""
    Image.fromarray(picture).save(path, "PNG")


def _number(path: Path) -> str:
    lines = [line for line in path.read_text(errors="replace").split() if line.isdigit()]
    return lines[-1] if lines else ""
