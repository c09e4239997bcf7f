"""Registry of the fleets running on this machine; each is a file that its command keeps up to date.

``./pioneer status`` and other commands find a fleet here in a few milliseconds, without ROS. The command holds a lock
on its file, so that a killed command's stale file is recognised even if its PID has been reused.
"""

import contextlib
import fcntl
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class Entry:
    """Registers this process's fleet until closed."""

    def __init__(self) -> None:
        folder = _folder()
        folder.mkdir(mode=0o700, exist_ok=True)
        self._path = folder / f"{os.getpid()}.json"
        self._lock = self._path.with_suffix(".unlocked").open("w")
        fcntl.flock(self._lock, fcntl.LOCK_EX)
        Path(self._lock.name).rename(self._path.with_suffix(".lock"))

    def write(self, status: dict[str, Any]) -> None:
        """Publishes the fleet's status, a value for ``json.dumps``, atomically."""
        new = self._path.with_suffix(".new")
        new.write_text(json.dumps({**status, "pid": os.getpid()}))
        new.replace(self._path)

    def close(self) -> None:
        """Removes the fleet from the registry."""
        self._path.unlink(missing_ok=True)
        self._path.with_suffix(".lock").unlink(missing_ok=True)
        self._lock.close()


def running_fleets() -> list[dict[str, Any]]:
    """Returns the status of each of this user's fleets running on this machine, oldest first."""
    return sorted(_living(), key=lambda status: float(status["started"]))


def _living() -> Iterator[dict[str, Any]]:
    for lock in _folder().glob("*.lock"):
        path = lock.with_suffix(".json")
        # A fleet that ends meanwhile removes its files.
        with contextlib.suppress(FileNotFoundError), lock.open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                yield json.loads(path.read_text())
            else:  # killed
                path.unlink(missing_ok=True)
                lock.unlink()


def _folder() -> Path:
    return Path(tempfile.gettempdir()) / f"pioneer-fleets-{os.getuid()}"
