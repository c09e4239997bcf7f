"""Output folders: each belongs to one running command."""

import fcntl
import os
from pathlib import Path

from pioneer_demo.error import FolderInUseError

_LOCK = ".lock"


class FolderLock:
    """A folder that this process alone writes to; a context manager.

    The kernel releases the lock when the process ends, however it ends.
    """

    def __init__(self, folder: Path) -> None:
        """Creates the folder, if it is missing, and locks it.

        Raises:
            FolderInUseError: another command has locked it.
            OSError: the folder cannot be created or written to.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._file = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(self._file, 20).decode(errors="replace").strip()
            os.close(self._file)
            raise FolderInUseError(folder, owner) from None
        except OSError:
            os.close(self._file)
            raise
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)

    def release(self) -> None:
        """Lets other commands use the folder."""
        os.close(self._file)

    def __enter__(self) -> "FolderLock":
        return self

    def __exit__(self, *_: object) -> None:
        self.release()
