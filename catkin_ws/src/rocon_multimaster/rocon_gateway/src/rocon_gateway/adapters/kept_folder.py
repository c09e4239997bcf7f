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
        with contextlib.suppress(OSError):  # `text` then logs why the folder cannot be read
            path.mkdir(parents=True, exist_ok=True)

    def text(self) -> str:
        """Returns all files as a JSON object from name to content; empty if there are none or they are too large."""
        with self._lock:
            try:
                names = sorted(one.name for one in os.scandir(self._path) if _NAME.fullmatch(one.name))
                found = {name: (self._path / name).read_text() for name in names}
            except (OSError, UnicodeDecodeError) as error:
                return self._nothing(f"{self._path} is not kept by the hub: {error}")
            text = json.dumps(found) if found else ""
            if len(text) > LARGEST:
                return self._nothing(f"{self._path} is not kept by the hub: more than {LARGEST} characters")
            return text

    def _nothing(self, complaint: str) -> str:
        if complaint != self._complaint:
            self._complaint = complaint
            self._logger.warning("%s", complaint)
        return ""

    def restore(self, text: str) -> str:
        """Writes the stored files if the folder is empty; returns the folder's content afterwards."""
        own = self.text()
        if own or not text:
            return own
        with self._lock:
            try:
                kept = json.loads(text) if len(text) <= LARGEST else None
                for name, content in kept.items() if isinstance(kept, dict) else ():
                    if _NAME.fullmatch(name) and isinstance(content, str):
                        beside = self._path / f".{name}"
                        beside.write_text(content)
                        beside.replace(self._path / name)
            except (OSError, ValueError, RecursionError) as error:
                return self._nothing(f"what the hub kept of {self._path} cannot be written: {error}")
        return self.text()
