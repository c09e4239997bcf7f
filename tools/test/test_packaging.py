"""The Debian package: it depends on all programs that the sources start, and is built before it is tried."""

import ast
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from text_check import ROOT, project_files

SECTIONS = ("run", "view", "web")
"""Sections of apt-packages.txt that packaging/build writes for ``@run@``."""
EVERYWHERE = {"util-linux", "python3-minimal"}


def named() -> set[str]:
    """Returns the packages that the .deb depends on or suggests."""
    control = (ROOT / "packaging" / "debian" / "control.in").read_text()
    fields = re.findall(r"^(?:Depends|Suggests): (.*)$", control, re.MULTILINE)
    own = {name.strip() for field in fields for name in field.split(",")}
    listed = re.split(r"^## ", (ROOT / "apt-packages.txt").read_text(), flags=re.MULTILINE)
    return own.union(
        *(
            text.split("\n")
            for text in listed
            if text.startswith(tuple(f"{one}\n" for one in SECTIONS))
        )
    )


def started(text: str) -> Iterator[str]:
    """Yields the programs that are named in calls of ``subprocess`` and ``which``."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        called, first = ast.unparse(node.func), node.args[0]
        if called.startswith("subprocess.") and isinstance(first, ast.List) and first.elts:
            first = first.elts[0]
        elif called != "shutil.which":
            continue
        if isinstance(first, ast.Constant):
            yield first.value


def owners(program: str) -> set[str]:
    """Returns the installed packages that contain a program."""
    command = ["dpkg-query", "--search", f"/bin/{program}", f"/usr/bin/{program}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return {line.split(":")[0] for line in found.splitlines()}


def test_programs_that_the_sources_start_are_of_packages_that_the_deb_names() -> None:
    sources = [
        path
        for path in project_files()
        if path.suffix == ".py" and path.is_relative_to(ROOT / "catkin_ws/src")
    ]
    programs = {
        one for path in sources if "test" not in path.parts for one in started(path.read_text())
    }
    assert {"ip", "openssl", "ffmpeg"} <= programs
    missing = {
        one: owners(one)
        for one in programs
        if owners(one) and not owners(one) & (named() | EVERYWHERE)
    }
    assert missing == {}


@pytest.mark.parametrize("option", ["--try", "--test"])
def test_the_package_must_be_built_before_it_is_installed(option: str, tmp_path: Path) -> None:
    for name in ("packaging/build", "tools/setup.bash", "VERSION"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    command = [str(tmp_path / "packaging/build"), option]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    version = (ROOT / "VERSION").read_text().strip()
    told = f"pioneer: no package of version {version} in dist/: run ./pioneer package first\n"
    assert (done.returncode, done.stderr) == (1, told)
