"""A kernel that was built once is copied, whatever the dates of its files and the folder of the checkout."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from pioneer_kernels.build import digest

KERNEL = '''"""Adds."""
from pioneer_kernels.declaration import kernel


@kernel
def total(a: float, b: float) -> float:
    """Returns the sum."""
    return a + b
'''
WITHOUT_NUMBA = "raise ImportError('numba is not needed')\n"


def build(
    folder: Path, cache: Path, before: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Builds the kernel of a checkout; modules in the folder ``before`` hide installed ones."""
    source = folder / "src" / "adder" / "sum_kernel.py"
    paths = [*([str(before)] if before else []), *sys.path]
    words = ["--reads", str(source), "--source-root", str(folder / "src")]
    words += [
        "--module",
        "adder.sum_kernel",
        "--extension",
        "_sum",
        "--output",
        str(folder / "out"),
    ]
    return subprocess.run(
        [sys.executable, "-m", "pioneer_kernels.build", *words],
        env={**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )


def checkout(folder: Path, source: str = KERNEL) -> Path:
    package = folder / "src" / "adder"
    package.mkdir(parents=True)
    (folder / "out").mkdir()
    (package / "__init__.py").write_text('"""Adds."""\n')
    (package / "sum_kernel.py").write_text(source)
    return folder


def made(folder: Path) -> Path:
    return folder / "out" / f"_sum{sysconfig.get_config_var('EXT_SUFFIX')}"


def test_another_checkout_of_the_same_sources_compiles_nothing(tmp_path: Path) -> None:
    first, second = checkout(tmp_path / "first"), checkout(tmp_path / "second")
    done = build(first, tmp_path / "cache")
    assert (done.returncode, done.stderr) == (0, "")
    (tmp_path / "numba.py").write_text(WITHOUT_NUMBA)
    os.utime(second / "src" / "adder" / "sum_kernel.py")
    done = build(second, tmp_path / "cache", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert made(second).read_bytes() == made(first).read_bytes()
    assert list(first.joinpath("out").iterdir()) == [made(first)]
    third = checkout(tmp_path / "third", KERNEL.replace("a + b", "a - b"))
    assert "numba is not needed" in build(third, tmp_path / "cache", tmp_path).stderr
    assert not made(third).exists()


def test_a_cache_that_cannot_be_written_costs_only_the_next_compilation(tmp_path: Path) -> None:
    folder = checkout(tmp_path / "only")
    (tmp_path / "cache").write_text("a file is in the way")
    done = build(folder, tmp_path / "cache")
    assert done.returncode == 0
    assert "not kept for other builds" in done.stderr
    assert made(folder).exists()


@pytest.mark.parametrize("variable", ["CFLAGS", "NUMBA_BOUNDSCHECK"])
def test_what_changes_the_machine_code_changes_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    source = tmp_path / "sum_kernel.py"
    source.write_text(KERNEL)
    before = digest([source], ["--cpu", "host"])
    assert digest([source], ["--cpu", "host"]) == before
    assert digest([source], ["--cpu", "x86-64"]) != before
    monkeypatch.setenv(variable, "1")
    assert digest([source], ["--cpu", "host"]) != before
