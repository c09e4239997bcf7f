"""Builds one kernel's extension, or takes it from the user's cache: ``python3 -m pioneer_kernels.build``.

The cache holds extensions by the contents that they were made of, so that another checkout, or sources with new dates,
need no compilation. It is a folder ``pioneer/kernels`` below ``XDG_CACHE_HOME`` or ``~/.cache`` and may be deleted.
"""

import argparse
import hashlib
import importlib.metadata
import os
import platform
import shutil
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

KEPT = 30 * 86400.0
"""Extensions that no build has used for so long are removed [s]."""


def digest(reads: Iterable[Path], words: Sequence[str]) -> str:
    """Returns what identifies an extension: everything that decides its bytes.

    Args:
        reads: the kernel module and every module of its package that it imports.
        words: the arguments of `pioneer_kernels.compile` without folders.
    """
    found = hashlib.sha256()
    for part in _ingredients(reads, words):
        found.update(len(part).to_bytes(8, "little") + part)
    return found.hexdigest()


def _ingredients(reads: Iterable[Path], words: Sequence[str]) -> Iterator[bytes]:
    own = Path(__file__).parent
    for path in (*sorted(reads), own / "compile.py", own / "declaration.py"):
        yield path.name.encode()
        yield path.read_bytes()
    yield from (word.encode() for word in words)
    for package in ("numba", "llvmlite", "numpy"):
        yield importlib.metadata.version(package).encode()
    yield f"{sys.version} {platform.machine()}".encode()
    yield _processor().encode()
    for name, value in sorted(os.environ.items()):
        if name.startswith("NUMBA_") or name in ("CC", "CFLAGS"):
            yield f"{name}={value}".encode()


def _processor() -> str:
    """Returns what the kernel says of the first processor's model and features."""
    about = Path("/proc/cpuinfo").read_text().partition("\n\n")[0]
    told = ("vendor_id", "cpu family", "model", "stepping", "flags")
    return "\n".join(line for line in about.splitlines() if line.startswith(told))


def cache_folder() -> Path:
    """Returns the folder of the extensions, which may not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pioneer" / "kernels"


def _place(source: Path, target: Path) -> None:
    """Copies a file so that no process ever sees a part of it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        os.replace(shutil.copy(source, folder), target)


def _remove_unused(folder: Path) -> None:
    for path in folder.glob("*.so"):
        if time.time() - path.stat().st_mtime > KEPT:
            path.unlink(missing_ok=True)


def main() -> int:
    """Builds the extension named on the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="pioneer_kernels.build", description=__doc__)
    parser.add_argument(
        "--reads", type=Path, nargs="+", required=True, help="files that the kernel is made of"
    )
    parser.add_argument("--source-root", required=True, help="folder that holds the package")
    parser.add_argument("--module", required=True, help="dotted name of the kernel module")
    parser.add_argument("--extension", required=True, help="name of the extension to write")
    parser.add_argument(
        "--output", type=Path, required=True, help="folder the extension is written to"
    )
    parser.add_argument("--cpu", default="host", help="LLVM processor name (default: %(default)s)")
    options = parser.parse_args()
    words = ["--module", options.module, "--extension", options.extension, "--cpu", options.cpu]
    made = options.output / f"{options.extension}{sysconfig.get_config_var('EXT_SUFFIX')}"
    folder = cache_folder()
    kept = folder / f"{digest(options.reads, words)}.so"
    try:
        _place(kept, made)
        os.utime(kept)
        return 0
    except OSError:
        pass  # not there, or not ours to read: compile
    from pioneer_kernels.compile import main as compile_kernel  # numba takes a second to import

    folders = ["--source-root", options.source_root, "--output", str(options.output)]
    status = compile_kernel([*words, *folders])
    if status == 0:
        try:
            _place(made, kept)
            _remove_unused(folder)
        except OSError as error:
            print(f"pioneer_kernels.build: not kept for other builds: {error}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
