"""Lists the project's own files, even without git."""

import os
from collections.abc import Iterable, Iterator
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def project_files() -> Iterator[Path]:
    """Yields the project's files, except those that its `.gitignore` excludes."""
    lines = (ROOT / ".gitignore").read_text().splitlines()
    patterns = ["/.git", "/.git/", *lines]  # in a worktree, .git is a file
    for folder, folders, files in os.walk(ROOT):
        prefix = f"{folder}/".removeprefix(f"{ROOT}/")
        folders[:] = [name for name in folders if not _ignored(f"{prefix}{name}/", patterns)]
        yield from (Path(folder, name) for name in files if not _ignored(f"{prefix}{name}", patterns))


def _ignored(path: str, patterns: Iterable[str]) -> bool:
    name = path.rstrip("/").rpartition("/")[2] + "/" * path.endswith("/")
    return any(fnmatch(f"/{path}" if pattern.startswith("/") else name, pattern) for pattern in patterns)
