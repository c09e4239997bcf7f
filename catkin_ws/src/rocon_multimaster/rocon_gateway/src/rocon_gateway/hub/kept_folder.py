"""A folder backed up on the hubs, so that a gateway of the same name can restore it on another computer."""

import contextlib
import json
import logging
import os
import re
import threading
from pathlib import Path

LARGEST = 65536
"""Maximum size of all files together as JSON [characters]; beyond it, nothing is stored."""

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,99}")
"""Pattern of file names. Other files are skipped, so temporary files can start with a dot."""


class KeptFolder:
    """The folder, created if absent, and its content as one text. `text` and `restore` may be called from any thread.

    Args:
        path: path of the folder.
        logger: receives one line if the folder cannot be stored.
    """

    def __init__(self, path: Path, logger: logging.Logger) -> None:
        self._path, self._logger = path, logger
        self._lock = threading.Lock()
        self._complaint = ""
        #: whether the folder lacks files that the hub has, because they could not be written
        self._awaits_restore = False
        with contextlib.suppress(OSError):  # `text` then logs why the folder cannot be read
            path.mkdir(parents=True, exist_ok=True)

    def text(self) -> str | None:
        """Returns all files as a JSON object from name to content; empty if there are none.

        None if they cannot be read, are too large or were not restored: the hub's copy must then stay as it is.
        """
        with self._lock:
            text = self._text()
        return None if self._awaits_restore and not text else text

    def _text(self) -> str | None:
        try:
            names = sorted(one.name for one in os.scandir(self._path) if _NAME.fullmatch(one.name))
            found = {name: (self._path / name).read_text() for name in names}
        except (OSError, UnicodeDecodeError) as error:
            self._complain(f"{self._path} is not kept by the hub: {error}")
            return None
        if not found:
            return ""
        text = json.dumps(found)
        if len(text) > LARGEST:
            self._complain(f"{self._path} is not kept by the hub: more than {LARGEST} characters")
            return None
        return text

    def _complain(self, complaint: str) -> None:
        if complaint != self._complaint:
            self._complaint = complaint
            self._logger.warning("%s", complaint)

    def restore(self, text: str) -> str:
        """Writes the stored files if the folder is empty; returns what the hub is to store from now on."""
        with self._lock:
            own = self._text()
            if own is None:
                return text
            if own or not text:
                return own
            try:
                self._write(text)
            except OSError as error:
                self._awaits_restore = True
                self._complain(f"what the hub kept of {self._path} cannot be written: {error}")
                return text
            except (ValueError, RecursionError) as error:
                self._complain(f"what the hub kept of {self._path} is invalid: {error}")
            self._awaits_restore = False
            own = self._text()
            return text if own is None else own

    def _write(self, text: str) -> None:
        """Writes all valid files, or none if one cannot be written."""
        kept = json.loads(text) if len(text) <= LARGEST else None
        valid = {
            name: content
            for name, content in (kept.items() if isinstance(kept, dict) else ())
            if _NAME.fullmatch(name) and isinstance(content, str)
        }
        try:
            for name, content in valid.items():
                self._beside(name).write_text(content)
            for name in valid:
                self._beside(name).replace(self._path / name)
        finally:
            for name in valid:
                with contextlib.suppress(OSError):
                    self._beside(name).unlink(missing_ok=True)

    def _beside(self, name: str) -> Path:
        return self._path / f".{name}"
