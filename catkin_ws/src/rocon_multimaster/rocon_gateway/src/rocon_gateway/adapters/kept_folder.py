"""A folder whose files the hubs keep a copy of, for a gateway of our name that starts on another computer."""

import contextlib
import json
import logging
import os
import re
import threading
from pathlib import Path

LARGEST = 65536
"""What all files may have together, as JSON [characters]: of more, nothing is kept."""

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,99}")
"""Of a file; others are left out, so that one that is being written may have a name with a dot in front."""


class KeptFolder:
    """The folder, made if absent, and what is in it as one text. `text` and `restore` may be called from any thread.

    Args:
        path: the folder's.
        logger: takes a line for a folder that cannot be kept, once.
    """

    def __init__(self, path: Path, logger: logging.Logger) -> None:
        self._path, self._logger = path, logger
        self._lock = threading.Lock()
        self._complaint = ""
        with contextlib.suppress(OSError):  # `text` then logs why the folder cannot be read
            path.mkdir(parents=True, exist_ok=True)

    def text(self) -> str:
        """Returns all files as JSON, name to content; empty where there are none, or too much."""
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
        """Writes what a hub has kept if there are no files here; returns what is in the folder then."""
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
