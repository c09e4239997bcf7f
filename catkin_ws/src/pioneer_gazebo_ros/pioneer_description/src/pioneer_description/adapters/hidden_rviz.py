"""RViz on a screen that nobody sees (Xvfb), and pictures of that screen."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from pioneer_harness.process import ProcessGroup
from pioneer_harness.screen import HiddenScreen


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
        self._screen, self._rviz = HiddenScreen(size), ProcessGroup()
        try:
            shown = self._screen.folder / "shown.rviz"
            shown.write_text(yaml.safe_dump(dict(config), allow_unicode=True))
            argv = ["rviz", "--fullscreen", "-d", str(shown), "__name:=rviz"]
            environment = {**os.environ, **self._screen.variables}
            self._rviz.start("rviz", argv, environment, self._screen.folder / "rviz.log")
        except BaseException:
            self.close()
            raise

    def picture(self) -> "np.ndarray[Any, np.dtype[np.uint8]]":
        """Returns the screen as it is now, shape (height, width, 3).

        Raises:
            ProcessDiedError: RViz or its screen has ended; with their last words.
        """
        self._rviz.check()
        return self._screen.picture()

    def close(self) -> None:
        """Ends both, RViz first: without its screen it would die without telling the master."""
        self._rviz.stop()
        self._screen.close()

    def __enter__(self) -> "HiddenRviz":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def save(picture: "np.ndarray[Any, np.dtype[np.uint8]]", path: Path) -> None:
    """Writes a picture as PNG; OSError where that is not possible."""
    Image.fromarray(picture).save(path, "PNG")
