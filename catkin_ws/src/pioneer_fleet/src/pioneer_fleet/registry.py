"""Registry of the fleets running on this machine; each is a file that its command keeps up to date.

``./pioneer status`` and other commands find a fleet here in a few milliseconds, without ROS. The command holds a lock
on its file, so that a killed command's stale file is recognised even if its PID has been reused.

The folder is in XDG_RUNTIME_DIR, else in the folder for temporary files, where other users may have made one of that
name: a folder is used only if it belongs to this user and nobody else can reach into it.
"""

import contextlib
import fcntl
import json
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class RegistryError(OSError):
    """There is no folder that only this user can write to."""


class Entry:
    """Registers this process's fleet until closed.

    Raises:
        RegistryError: no folder is safe to use.
    """

    def __init__(self) -> None:
        folder = _own_folder()
        _remove_killed(folder)
        self._path = folder / f"{os.getpid()}.json"
        unlocked = self._path.with_suffix(".unlocked")
        unlocked.unlink(missing_ok=True)
        self._lock = os.open(
            unlocked, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600
        )
        fcntl.flock(self._lock, fcntl.LOCK_EX)
        unlocked.rename(self._path.with_suffix(".lock"))

    def write(self, status: dict[str, Any]) -> None:
        """Publishes the fleet's status, a value for ``json.dumps``, atomically."""
        new = self._path.with_suffix(".new")
        new.unlink(missing_ok=True)
        with open(
            os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600), "w"
        ) as file:
            json.dump({**status, "pid": os.getpid(), "written": time.monotonic()}, file)
        new.replace(self._path)

    def close(self) -> None:
        """Removes the fleet from the registry; no effect if it is removed already."""
        if self._lock < 0:
            return
        self._path.unlink(missing_ok=True)
        self._path.with_suffix(".lock").unlink(missing_ok=True)
        os.close(self._lock)
        self._lock = -1


def running_fleets() -> list[dict[str, Any]]:
    """Returns the status of each of this user's fleets running on this machine, oldest first.

    Each has its ``age``, the time since its command has written it [s].
    """
    fleets = [status for folder in _folders() if _is_own(folder) for status in _living(folder)]
    return sorted(fleets, key=lambda status: float(status["started"]))


def _living(folder: Path) -> Iterator[dict[str, Any]]:
    _remove_killed(folder)
    for lock in folder.glob("*.lock"):
        # A fleet that ends meanwhile removes its files.
        with contextlib.suppress(FileNotFoundError), _opened(lock.with_suffix(".json")) as text:
            status = json.load(text)
            # The monotonic clock is the same for all processes of a machine.
            status["age"] = max(0.0, time.monotonic() - float(status.pop("written", 0.0)))
            yield status


def _remove_killed(folder: Path) -> None:
    """Removes the files of fleets that were killed: nobody holds their locks."""
    for lock in folder.glob("*.lock"):
        with contextlib.suppress(FileNotFoundError), _opened(lock) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            # A new fleet with the PID of the killed one may have replaced the file meanwhile.
            if os.path.samestat(os.fstat(file.fileno()), lock.stat()):
                for suffix in (".json", ".new", ".lock"):
                    lock.with_suffix(suffix).unlink(missing_ok=True)


def _opened(path: Path) -> Any:
    return open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW))


def _folders() -> list[Path]:
    """Returns the folders where this user's fleets may be registered, the preferred one first."""
    folders = [Path(tempfile.gettempdir()) / f"pioneer-fleets-{os.getuid()}"]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime:
        folders.insert(0, Path(runtime) / "pioneer-fleets")
    return folders


def _own_folder() -> Path:
    for folder in _folders():
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
            if _is_own(folder):
                return folder
    named = " or ".join(map(str, _folders()))
    raise RegistryError(
        f"{named} must belong to this user, with mode 0700: remove it, or set XDG_RUNTIME_DIR"
    )


def _is_own(folder: Path) -> bool:
    """Returns whether this is a folder, not a link to one, that belongs to this user and only this user can enter."""
    try:
        state = os.lstat(folder)
    except OSError:
        return False
    return stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o077
