"""A recording of the fleet, on and off."""

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pioneer_web.core.command import CommandError

_END = 60.0
"""For the recorder to complete its file [s]."""


class Recording:
    """Runs ``pioneer_fleet``'s recorder as a process beside this one.

    Args and attributes:
        folder: where files are put.
        masters: what is recorded, NAME=URI each.
    """

    def __init__(self, folder: Path, masters: Sequence[str]) -> None:
        self.folder, self._masters = folder, masters
        folder.mkdir(parents=True, exist_ok=True)
        self._process: subprocess.Popen[str] | None = None
        self._file = ""

    @property
    def file(self) -> str:
        """What is recorded to; empty while nothing is."""
        return self._file if self._process and self._process.poll() is None else ""

    def start(self) -> str:
        """Begins a file and returns what was done, in words.

        Raises:
            CommandError: one is under way, or it cannot be written.
        """
        if self.file:
            raise CommandError(f"{self._file} is being recorded already")
        path = self.folder / time.strftime("fleet-%Y%m%d-%H%M%S.mcap")
        words = [sys.executable, "-m", "pioneer_fleet.adapters.recorder", str(path), *self._masters]
        try:
            self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        except OSError as error:
            raise CommandError(f"{path} cannot be recorded: {error.strerror}") from None
        self._file = str(path)
        return f"recording to {path}"

    def stop(self) -> str:
        """Completes the file and returns what it holds, in words.

        Raises:
            CommandError: nothing is recorded, or the recorder failed.
        """
        process, self._process = self._process, None
        if process is None:
            raise CommandError("nothing is being recorded")
        process.terminate()
        try:
            said, _ = process.communicate(timeout=_END)
        except subprocess.TimeoutExpired:
            process.kill()
            raise CommandError(
                f"{self._file}: the recorder did not end in {_END:g} s; the file is incomplete"
            ) from None
        if process.returncode:
            raise CommandError(f"{self._file}: the recorder ended with exit status {process.returncode}; see the log")
        return said.strip()

    def close(self) -> None:
        """Completes the file if there is one."""
        if self.file:
            self.stop()
