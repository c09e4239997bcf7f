"""Finds links in Markdown files to files or headings that do not exist in the project."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from sources import ROOT, project_files

_LINK = re.compile(r"(?<!`)\[(?:[^\]\[]|\[[^\]]*\])*\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)


def broken_links(root: Path, names: list[str]) -> Iterator[str]:
    """Yields ``file: target`` for each broken relative link in the Markdown files ``names``."""
    for name in names:
        for target in _LINK.findall(_FENCE.sub("", (root / name).read_text())):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            file = ((root / name).parent / path) if path else root / name
            if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors(file.read_text())):
                yield f"{name}: {target}"


def anchors(text: str) -> set[str]:
    """Returns the anchors that GitHub and MyST generate for the headings of a Markdown text."""
    found: set[str] = set()
    for heading in re.findall(r"^#+ +(.*?)\s*$", _FENCE.sub("", text), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        number = next(k for k in range(len(found) + 1) if f"{slug}{f'-{k}' * bool(k)}" not in found)
        found.add(f"{slug}{f'-{number}' * bool(number)}")
    return found


if __name__ == "__main__":
    texts = [str(path.relative_to(ROOT)) for path in project_files() if path.suffix == ".md"]
    lines = list(broken_links(ROOT, texts))
    print("\n".join(lines))
    sys.exit(bool(lines))
