"""Whether a disk has room for a recording."""

import shutil
from pathlib import Path

RESERVE = 16 * 2**20
"""Free space that recordings leave to others, such as logs [bytes]."""


def has_room(folder: Path) -> bool:
    """Returns whether the disk of a folder has more free space than the reserve; True if it cannot tell."""
    try:
        return shutil.disk_usage(folder).free > RESERVE
    except OSError:
        return True
