"""Starts and stops recordings of the fleet."""

import collections
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from pioneer_web.command.command import CommandError

_END = 60.0
"""Time-out for the recorder to finish its file [s]."""
_KEPT = 20
"""Number of the recorder's last lines that are kept."""


class RecorderProcess:
    """A recorder as a child process, whose output is read as it comes: a full pipe would stop the recorder."""

    def __init__(self, words: Sequence[str]) -> None:
        """Starts it.

        Raises:
            OSError: it cannot be started.
        """
        self._process = subprocess.Popen(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="backslashreplace",
        )
        self._lines: collections.deque[str] = collections.deque(maxlen=_KEPT)
        self._reader = threading.Thread(target=self._read, name="recorder output", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            for line in output:
                if line.strip():
                    self._lines.append(line.strip())

    @property
    def status(self) -> int | None:
        """Its exit status; None while it runs."""
        return self._process.poll()

    @property
    def last_line(self) -> str:
        """The last line of its output, which is complete once it has ended; empty without output."""
        if self.status is not None:
            self._reader.join(_END)
        return self._lines[-1] if self._lines else ""

    def end(self) -> int:
        """Ends it; returns its exit status.

        Raises:
            subprocess.TimeoutExpired: it did not end in time and was killed.
        """
        self._process.terminate()
        try:
            return self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise


class Recording:
    """Runs ``pioneer_fleet``'s recorder as a child process.

    Args and attributes:
        folder: folder for the files.
        masters: masters to record, NAME=URI each.
    """

    def __init__(self, folder: Path, masters: Sequence[str]) -> None:
        self.folder, self._masters = folder, masters
        folder.mkdir(parents=True, exist_ok=True)
        self._process: RecorderProcess | None = None
        self._file = ""
        self._fault = ""
        self._lock = threading.Lock()

    @property
    def fault(self) -> str:
        """Why the last recording has ended without being asked to, such as a full disk; empty otherwise."""
        # The page's commands and its clock ask in threads of their own.
        with self._lock:
            if self._process is not None and self._process.status:
                self._fault = self._reason(self._process)
                self._process = None
            return self._fault

    @property
    def file(self) -> str:
        """Path of the current recording; empty while not recording."""
        return self._file if self._process and self._process.status is None else ""

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
            self._process = RecorderProcess(words)
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
        try:
            status = process.end()
        except subprocess.TimeoutExpired:
            raise CommandError(
                f"{self._file}: the recorder did not end in {_END:g} s; the file is incomplete"
            ) from None
        if status:
            raise CommandError(self._reason(process))
        return process.last_line

    def _reason(self, process: RecorderProcess) -> str:
        """Returns why a recorder has ended."""
        return (
            process.last_line
            or f"{self._file}: the recorder ended with exit status {process.status}"
        )

    def close(self) -> None:
        """Finishes the recording, if one is running."""
        if self.file:
            self.stop()
