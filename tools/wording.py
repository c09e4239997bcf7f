"""Refuses words that made readers stumble; ``wording.tsv`` lists them, each with what to write instead."""

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from sources import project_files

LIST = Path(__file__).with_suffix(".tsv")


def entries() -> list[tuple[re.Pattern[str], str]]:
    """Returns each pattern with its replacement advice."""
    pairs = (line.split("\t") for line in LIST.read_text().splitlines())
    return [(re.compile(pattern, re.IGNORECASE), better) for pattern, better in pairs]


def stumbles(paths: Iterable[Path]) -> Iterator[str]:
    """Yields ``path:line: word; write: …`` for each listed word in the texts among ``paths``."""
    words = entries()
    for path in paths:
        try:
            lines = path.read_text().splitlines()
        except UnicodeDecodeError:  # pictures and the like
            continue
        for number, line in enumerate(lines, 1):
            for pattern, better in words:
                for match in pattern.finditer(line):
                    yield f"{path}:{number}: '{match[0]}'; write: {better}"


def main() -> int:
    """Checks all files of the project; returns 1 if one contains a listed word, else 0."""
    found = list(stumbles(path for path in project_files() if path != LIST))
    for line in found:
        print(line)
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
