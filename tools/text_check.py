"""Checks of the project's own files; ``python3 tools/text_check.py CHECK`` prints what it finds, a line each.

``wording`` refuses words that made readers stumble; ``wording.tsv`` lists them, each with what to write instead.
``links`` finds links in Markdown files to files or headings that do not exist. ``version`` compares all package.xml
files and CHANGELOG.md with ``VERSION``.
"""

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "tools" / "wording.tsv"
_LINK = re.compile(r"(?<!`)\[(?:[^\]\[]|\[[^\]]*\])*\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)


def project_files(suffix: str = "") -> Iterator[Path]:
    """Yields the project's files that end in ``suffix``, except those that its `.gitignore` excludes."""
    lines = (ROOT / ".gitignore").read_text().splitlines()
    patterns = ["/.git", "/.git/", *lines]  # in a worktree, .git is a file
    for folder, folders, files in os.walk(ROOT):
        prefix = f"{folder}/".removeprefix(f"{ROOT}/")
        folders[:] = [name for name in folders if not _ignored(f"{prefix}{name}/", patterns)]
        yield from (
            Path(folder, name)
            for name in files
            if name.endswith(suffix) and not _ignored(f"{prefix}{name}", patterns)
        )


def _ignored(path: str, patterns: Iterable[str]) -> bool:
    name = path.rstrip("/").rpartition("/")[2] + "/" * path.endswith("/")
    return any(
        fnmatch(f"/{path}" if pattern.startswith("/") else name, pattern) for pattern in patterns
    )


def stumbles(paths: Iterable[Path]) -> Iterator[str]:
    """Yields ``path:line: word; write: …`` for each listed word in the texts among ``paths``."""
    pairs = (line.split("\t") for line in LIST.read_text().splitlines())
    words = [(re.compile(pattern, re.IGNORECASE), better) for pattern, better in pairs]
    for path in paths:
        try:
            lines = path.read_text().splitlines()
        except UnicodeDecodeError:  # pictures and the like
            continue
        for number, line in enumerate(lines, 1):
            for pattern, better in words:
                for match in pattern.finditer(line):
                    yield f"{path}:{number}: '{match[0]}'; write: {better}"


def broken_links(root: Path, names: list[str]) -> Iterator[str]:
    """Yields ``file: target`` for each broken relative link in the Markdown files ``names``."""
    for name in names:
        for target in _LINK.findall(_FENCE.sub("", (root / name).read_text())):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            file = ((root / name).parent / path) if path else root / name
            if not file.exists() or (
                anchor and file.suffix == ".md" and anchor not in anchors(file.read_text())
            ):
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


def other_versions(root: Path) -> list[str]:
    """Returns one line for each file under ``root`` with a version other than that in its ``VERSION``."""
    version = (root / "VERSION").read_text().strip()
    found = [
        (
            path,
            match.group(1)
            if (match := re.search(r"<version>(.*)</version>", path.read_text()))
            else "none",
        )
        for path in sorted((root / "catkin_ws" / "src").rglob("package.xml"))
    ]
    changelog = root / "CHANGELOG.md"
    released = re.findall(r"^## (\d\S*)", changelog.read_text(), re.MULTILINE)
    found.append((changelog, released[0] if released else "none"))
    return [
        f"{path.relative_to(root)}: version {other}, VERSION says {version}"
        for path, other in found
        if other != version
    ]


CHECKS: dict[str, Callable[[], Iterable[str]]] = {
    "wording": lambda: stumbles(path for path in project_files() if path != LIST),
    "links": lambda: broken_links(
        ROOT, [str(path.relative_to(ROOT)) for path in project_files(".md")]
    ),
    "version": lambda: other_versions(ROOT),
}
"""The checks by name, each with a function that returns the lines to print."""

if __name__ == "__main__":
    found = list(CHECKS[sys.argv[1]]())
    print(*found, sep="\n", end="\n" if found else "")
    sys.exit(bool(found))
