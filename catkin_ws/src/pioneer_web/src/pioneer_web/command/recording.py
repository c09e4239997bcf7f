"""Starts and stops recordings of the fleet."""

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pioneer_web.command.command import CommandError

_END = 60.0
"""Time-out for the recorder to finish its file [s]."""


class Recording:
    """Runs ``pioneer_fleet``'s recorder as a child process.

    Args and attributes:
        folder: folder for the files.
        masters: masters to record, NAME=URI each.
    """

    def __init__(self, folder: Path, masters: Sequence[str]) -> None:
        self.folder, self._masters = folder, masters
        folder.mkdir(parents=True, exist_ok=True)
        self._process: subprocess.Popen[str] | None = None
        self._file = ""

    @property
    def file(self) -> str:
        """Path of the current recording; empty while not recording."""
        return self._file if self._process and self._process.poll() is None else ""

    def start(self) -> str:
        """Starts a recording; returns a message for the user.

        Raises:
            CommandError: a recording is already running, or the recorder cannot be started.
        """
        if self.file:
            raise CommandError(f"{self._file} is being recorded already")
        path = self.folder / time.strftime("fleet-%Y%m%d-%H%M%S.mcap")
        words = [
            sys.executable,
            "-m",
            "pioneer_fleet.recording.recorder",
            str(path),
            *self._masters,
        ]
        try:
            self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        except OSError as error:
            raise CommandError(f"{path} cannot be recorded: {error.strerror}") from None
        self._file = str(path)
        return f"recording to {path}"

    def stop(self) -> str:
        """Finishes the recording; returns the recorder's summary.

        Raises:
            CommandError: no recording is running, or the recorder failed.
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
            raise CommandError(
                f"{self._file}: the recorder ended with exit status {process.returncode}; see the log"
            )
        return said.strip()

    def close(self) -> None:
        """Finishes the recording, if one is running."""
        if self.file:
            self.stop()
