"""Reads files named in a description; only regular files of limited size."""

import os
import stat
from pathlib import Path

from pioneer_gazebo.core.error import DescriptionError

LARGEST = 256 << 20
"""Maximum file size [bytes]."""


def content_of(path: str | Path) -> bytes:
    """Returns a file's content. Pipes and devices are refused without blocking, since they may never end.

    Raises:
        DescriptionError: it cannot be read, is not a regular file, or is too large.
    """
    try:
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise DescriptionError(f"{path}: is not a regular file")
            if status.st_size > LARGEST:
                raise DescriptionError(f"{path}: {status.st_size >> 20} MiB exceed the limit of {LARGEST >> 20}")
            return file.read(LARGEST)
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from None
