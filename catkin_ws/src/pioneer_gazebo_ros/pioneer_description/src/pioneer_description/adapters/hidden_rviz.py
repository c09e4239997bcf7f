"""RViz on a virtual display (Xvfb), and screenshots of it."""

import contextlib
import os
import select
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from PIL import Image, ImageGrab

SCREEN_TIME = 10.0
"""Time limit for Xvfb to open its screen [s]."""
LAST_LINES = 15
"""Number of lines of RViz's log quoted when RViz ends unexpectedly."""
_GRACE = 3.0
"""Time a program has to end after SIGINT before it is killed [s]."""
# A program must not outlive this process, even if this process is killed. A shell starts background jobs with SIGINT
# ignored, which a program would inherit.
_PREFIX = ("env", "--default-signal=INT", "setpriv", "--pdeathsig", "TERM", "--")

Picture = np.ndarray[Any, np.dtype[np.uint8]]
"""Shape (height, width, 3)."""


class RvizError(RuntimeError):
    """RViz or its virtual display failed to start, or has ended; the message says what to do."""


@contextlib.contextmanager
def running(argv: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[bytes]"]:
    """Runs a program in its own session and ends it with the block; ``options`` are passed to ``Popen``."""
    program = subprocess.Popen(
        [*_PREFIX, *argv], start_new_session=True, stdin=subprocess.DEVNULL, **options
    )
    try:
        yield program
    finally:
        program.send_signal(signal.SIGINT)
        try:
            program.wait(_GRACE)
        except subprocess.TimeoutExpired:
            program.kill()
            program.wait()


@contextlib.contextmanager
def hidden_screen(size: tuple[int, int], folder: Path) -> Iterator[dict[str, str]]:
    """Runs an X server on the first free display for the duration of the block.

    Args:
        size: width and height [pixels].
        folder: an empty folder for the server's log, also used as its clients' ``XDG_RUNTIME_DIR``.

    Yields:
        Environment variables for its clients; OpenGL is rendered in software.

    Raises:
        RvizError: Xvfb is not installed, or opens no screen in time.
    """
    _check_installed("Xvfb", "xvfb")
    reader, writer = os.pipe()
    # Xvfb writes the number of the first free display. Without -noreset it would restart, and meanwhile refuse
    # clients, whenever its last client disconnects, for example after a screenshot.
    geometry = f"{size[0]}x{size[1]}x24"
    argv = [
        "Xvfb",
        "-displayfd",
        str(writer),
        "-screen",
        "0",
        geometry,
        "-nolisten",
        "tcp",
        "-noreset",
    ]
    with (
        open(reader) as numbers,
        open(folder / "Xvfb.log", "wb") as log,
        running(argv, stdout=log, stderr=log, pass_fds=[writer]),
    ):
        os.close(writer)
        number = (
            numbers.readline().strip() if select.select([numbers], [], [], SCREEN_TIME)[0] else ""
        )
        if not number:
            raise RvizError(
                f"Xvfb has no screen within {SCREEN_TIME:g} s: {_end_of(folder / 'Xvfb.log')}"
            )
        yield {
            "DISPLAY": f":{number}",
            "XDG_RUNTIME_DIR": str(folder),
            "LIBGL_ALWAYS_SOFTWARE": "1",
        }


def picture_of(variables: Mapping[str, str]) -> Picture:
    """Returns the current content of a virtual display; raises OSError if the display has ended."""
    return np.asarray(ImageGrab.grab(xdisplay=variables["DISPLAY"]).convert("RGB"))


@contextlib.contextmanager
def hidden_rviz(
    config: Mapping[str, Any], size: tuple[int, int]
) -> Iterator[Callable[[], Picture]]:
    """Runs RViz full screen as the node ``/rviz`` for the duration of the block.

    Args:
        config: the RViz configuration.
        size: width and height of the screen [pixels].

    Yields:
        A function that returns the current screen. It raises RvizError or OSError once RViz or the display has ended.

    Raises:
        RvizError: Xvfb or rviz is not installed, or no screen opens in time.
    """
    _check_installed("rviz", "rviz")
    # RViz ends first: without its display it would die without unregistering from the master.
    with (
        TemporaryDirectory(prefix="hidden-rviz-") as name,
        hidden_screen(size, folder := Path(name)) as variables,
    ):
        (folder / "shown.rviz").write_text(yaml.safe_dump(dict(config), allow_unicode=True))
        argv = ["rviz", "--fullscreen", "-d", str(folder / "shown.rviz"), "__name:=rviz"]
        environment = {**os.environ, **variables}
        with (
            open(folder / "rviz.log", "wb") as log,
            running(argv, env=environment, stdout=log, stderr=log) as rviz,
        ):

            def picture() -> Picture:
                if rviz.poll() is not None:
                    raise RvizError(
                        f"RViz ended, status {rviz.returncode}: {_end_of(folder / 'rviz.log')}"
                    )
                return picture_of(variables)

            yield picture


def save(picture: Picture, path: Path) -> None:
    """Writes a picture as PNG; raises OSError on failure."""
    Image.fromarray(picture).save(path, "PNG")


def _check_installed(program: str, package: str) -> None:
    if shutil.which(program) is None:
        raise RvizError(f"{program} is not installed: apt install {package}")


def _end_of(log: Path) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-LAST_LINES:])
