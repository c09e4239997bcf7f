"""Starts and stops recordings of the fleet."""

import subprocess
import sys
import threading
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
        self._fault = ""
        self._lock = threading.Lock()

    @property
    def fault(self) -> str:
        """Why the last recording has ended without being asked to, such as a full disk; empty otherwise."""
        # The page's commands and its clock ask in threads of their own.
        with self._lock:
            if self._process is not None and self._process.poll():
                self._fault = self._last_line(self._process)
                self._process = None
            return self._fault

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
            self._process = subprocess.Popen(
                words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
        except OSError as error:
            raise CommandError(f"{path} cannot be recorded: {error.strerror}") from None
        self._file = str(path)
        self._fault = ""
        return f"recording to {path}"

    def stop(self) -> str:
        """Finishes the recording; returns the recorder's summary.

        Raises:
            CommandError: no recording is running, or the recorder failed.
        """
        if fault := self.fault:
            self._fault = ""
            raise CommandError(fault)
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
                _last_line_of(said)
                or f"{self._file}: the recorder ended with exit status {process.returncode}"
            )
        return said.strip()

    def _last_line(self, process: subprocess.Popen[str]) -> str:
        """Returns the last line of a recorder that has ended."""
        said, _ = process.communicate(timeout=_END)
        return (
            _last_line_of(said)
            or f"{self._file}: the recorder ended with exit status {process.returncode}"
        )

    def close(self) -> None:
        """Finishes the recording, if one is running."""
        if self.file:
            self.stop()


def _last_line_of(text: str) -> str:
    """Returns the last line that is not empty; empty if there is none."""
    lines = text.strip().splitlines()
    return lines[-1] if lines else ""
