"""Fails if a source file is too long to be read in one sitting."""

import sys
from pathlib import Path

LIMIT = 400
ROOT = Path(__file__).resolve().parent.parent
PLACES = ("catkin_ws/src", "tools")
SUFFIXES = {".py", ".bash", ".launch"}


def main() -> int:
    """Prints each file over the limit; returns 1 if there is one, else 0."""
    long_files = [
        (lines, path.relative_to(ROOT))
        for place in PLACES
        for path in sorted((ROOT / place).rglob("*"))
        if path.suffix in SUFFIXES and (lines := len(path.read_bytes().splitlines())) > LIMIT
    ]
    for lines, path in long_files:
        print(f"{path}: {lines} lines, the limit is {LIMIT}; split it by job")
    return 1 if long_files else 0


if __name__ == "__main__":
    sys.exit(main())
