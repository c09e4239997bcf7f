"""Where recordings go: names of files, room on the disk."""

import itertools
import shutil
from pathlib import Path

RESERVE = 16 * 2**20
"""Free space that recordings leave to others, such as logs [bytes]."""


def free_name(path: Path) -> Path:
    """Returns the first of NAME-2, NAME-3, … that no file has yet, for a recording that continues ``path``."""
    others = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(candidate for candidate in others if not candidate.exists())


def has_room(folder: Path) -> bool:
    """Returns whether the disk of a folder has more free space than the reserve; True if it cannot tell."""
    try:
        return shutil.disk_usage(folder).free > RESERVE
    except OSError:
        return True
