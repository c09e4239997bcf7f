"""Finds the unit tests that a change of Python files may affect: those that import a changed module."""

import ast
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path


class ChangeError(Exception):
    """git cannot say what has changed."""


def changed_files(root: Path, base: str) -> list[Path]:
    """Returns the files below ``root`` that differ from the commit ``base``, with those that git does not track yet.

    Raises:
        ChangeError: this is no checkout, or there is no such commit.
    """
    tracked = _git(root, "diff", "--name-only", "-z", base, "--")
    untracked = _git(root, "ls-files", "--others", "--exclude-standard", "-z")
    names = f"{tracked}{untracked}".split("\0")
    return sorted(root / name for name in names if name)


def _git(root: Path, *words: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        raise ChangeError("git is not installed: apt install git") from None
    if done.returncode:
        reason = done.stderr.strip().splitlines()
        raise ChangeError(f"git {words[0]}: {reason[-1] if reason else 'failed'}")
    return done.stdout


def modules_below(roots: Iterable[Path]) -> dict[str, Path]:
    """Returns the Python modules in these import roots, by dotted name."""
    found: dict[str, Path] = {}
    for root in roots:
        for path in root.rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            if parts[-1] == "__init__":
                parts = parts[:-1]
            if parts:
                found.setdefault(".".join(parts), path)
    return found


def affected(
    tests: Iterable[Path], changed: Iterable[Path], modules: Mapping[str, Path]
) -> list[Path]:
    """Returns those of the test files that changed, or that import a changed module directly or through others."""
    changes = set(changed)
    imported = _Imports(modules)
    return [path for path in tests if path in changes or changes & imported.reached_from(path)]


class _Imports:
    """What files import of ``modules``; each file is parsed once."""

    def __init__(self, modules: Mapping[str, Path]) -> None:
        self._modules = modules
        self._direct: dict[Path, set[Path]] = {}

    def reached_from(self, path: Path) -> set[Path]:
        """Returns the files that ``path`` imports, directly or through others."""
        reached: set[Path] = set()
        pending = [path]
        while pending:
            for imported in self._imported_by(pending.pop()):
                if imported not in reached:
                    reached.add(imported)
                    pending.append(imported)
        return reached

    def _imported_by(self, path: Path) -> set[Path]:
        if path not in self._direct:
            names = _imported_names(path)
            self._direct[path] = {self._modules[name] for name in names if name in self._modules}
        return self._direct[path]


def _imported_names(path: Path) -> Iterator[str]:
    """Yields each dotted name that may be an imported module, packages on the way to it included."""
    for node in ast.walk(ast.parse(path.read_bytes(), str(path))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _with_parents(alias.name)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from _with_parents(node.module)
            for alias in node.names:
                yield f"{node.module}.{alias.name}"


def _with_parents(name: str) -> Iterator[str]:
    parts = name.split(".")
    for length in range(1, len(parts) + 1):
        yield ".".join(parts[:length])
