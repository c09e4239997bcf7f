"""The image: base, wheels, build. Skips every step that is already done."""

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from containers.engine import DESKTOP, ROS2, WEB, ContainerError, output, say

ROOT = Path(__file__).resolve().parent.parent.parent
LOG = ROOT / ".setup" / "log" / "image.log"
"""Of the image that is being built; the long stages have logs of their own beside it."""
WHEELS = ROOT / "docker" / "wheels"
LABEL = "pioneer.sources"
PROXIES = ("http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
_PARTS = (
    "apt-packages.txt",
    "requirements.txt",
    "docker/Dockerfile",
    "docker/dpkg.cfg",
    "docker/dpkg-run.cfg",
    "docker/beside-base",
    "docker/computer",
    "docker/desktop",
    "docker/healthy",
    "docker/ros2",
    "docker/web",
)
MACHINES = ("x86_64", "AMD64")
"""Names of x86-64: the wheels are fetched for this architecture only."""
_FLEET, _REGISTRY = "docker/Dockerfile", "docker/Dockerfile.registry"
_CHOICE = (
    *("--no-deps", "--only-binary", ":all:", "--python-version", "3.11", "--implementation", "cp"),
    *("--platform", "manylinux2014_x86_64", "--platform", "manylinux_2_28_x86_64"),
)
"""pip options that select packages for the image's Debian 12."""
_SECTIONS: dict[str, tuple[str, ...]] = {
    DESKTOP: (),
    WEB: ("web", "record"),
    ROS2: ("ros2",),
}
"""Sections of the requirements for the extras: the page with recordings, the door to ROS 2."""
_LONG_STAGES = ("packages", "build")
"""Stages of the fleet's image that do not depend on each other."""


def ensure_images(extras: Sequence[str], fleet: bool = True) -> None:
    """Builds the missing images: the ``fleet``'s, unless ``PIONEER_IMAGE`` names one, and those of ``extras``.

    Raises:
        ContainerError: a step failed.
    """
    name = os.environ.get("PIONEER_IMAGE", "pioneer")
    if fleet and "PIONEER_IMAGE" not in os.environ:
        ensure_image(name)
    for extra in extras:
        ensure_extra_image(extra, name)


def is_outdated() -> bool:
    """Returns whether the fleet's image was built from other sources than the checkout has now."""
    if "PIONEER_IMAGE" in os.environ:
        return False
    return _label("pioneer") not in ("", source_hash())


def ensure_image(name: str) -> None:
    """Builds the image ``name`` unless it is up to date with the sources.

    Raises:
        ContainerError: a step failed.
    """
    sources = source_hash()
    if _label(name) == sources:
        return
    if platform.machine() not in MACHINES:
        raise ContainerError(
            f"the image {name} is built on x86-64 only; this machine is {platform.machine()}"
        )
    _begin(name)
    run_step([str(ROOT / "docker" / "base")])
    _ensure_wheels()
    _prepare_stages()
    _build(_FLEET, name, sources)


def ensure_extra_image(extra: str, base: str) -> None:
    """Builds the image of an extra on top of the image ``base``, unless it is up to date.

    Raises:
        ContainerError: a step failed.
    """
    name, file = f"{base}-{extra}", f"docker/Dockerfile.{extra}"
    packages = [one for section in _SECTIONS[extra] for one in requirements(section)]
    found = hashlib.sha256(output("docker", "image", "inspect", "-f", "{{.Id}}", base).encode())
    found.update((ROOT / file).read_bytes() + " ".join(packages).encode())
    sources = found.hexdigest()[:32]
    if _label(name) == sources:
        return
    _begin(name)
    context = ROOT / ".setup" / "containers" / f"{extra}-context"
    shutil.rmtree(context, ignore_errors=True)
    context.mkdir(parents=True)
    if packages:
        say(f"fetching {len(packages)} Python packages")
        run_step(
            [*_pip(packages), "install", *_CHOICE, "--target", str(context / "packages"), *packages]
        )
    _build(file, name, sources, "--build-arg", f"IMAGE={base}", context=str(context))


def ensure_registry_image(name: str) -> None:
    """Builds the registry's image ``name`` unless it is up to date with the sources.

    Raises:
        ContainerError: a step failed.
    """
    files = [(ROOT / part).read_bytes() for part in (_REGISTRY, "docker/registry")]
    sources = hashlib.sha256(b"".join(files)).hexdigest()[:32]
    if _label(name) != sources:
        _begin(name)
        run_step([str(ROOT / "docker" / "base")])
        _build(_REGISTRY, name, sources)


def _begin(name: str) -> None:
    LOG.parent.mkdir(parents=True, exist_ok=True)
    LOG.write_bytes(b"")
    say(
        f"building the image {name} (the first time takes some minutes; log: {LOG.relative_to(ROOT)})"
    )


def _prepare_stages() -> None:
    """Builds the long stages in parallel, so that the main build finds them in the cache.

    Docker's classic builder builds stages one after the other, including all that precede the requested one in the
    file; so each stage gets its own Dockerfile.
    """
    text = (ROOT / _FLEET).read_text()

    def prepare(*stages: str) -> None:
        own = LOG.with_name(f"image-{stages[-1]}.log")
        own.write_bytes(b"")
        file = own.with_suffix(".Dockerfile")
        file.write_text(selected_stages(text, *stages))
        run_step(_build_command(str(file)), own)

    prepare("inputs")
    with ThreadPoolExecutor() as pool:
        for prepared in [pool.submit(prepare, "inputs", stage) for stage in _LONG_STAGES]:
            prepared.result()


def selected_stages(text: str, *names: str) -> str:
    """Returns a Dockerfile with only the named stages, and what precedes the first stage."""
    before, *stages = re.split(r"^(?=FROM )", text, flags=re.M)
    return before + "".join(
        stage for stage in stages if stage.partition("\n")[0].partition(" AS ")[2] in names
    )


def _build(file: str, name: str, sources: str, *options: str, context: str = ".") -> None:
    run_step(
        _build_command(file, "-t", name, "--label", f"{LABEL}={sources}", *options, context=context)
    )


def _build_command(file: str, *options: str, context: str = ".") -> list[str]:
    # Docker passes these to the build's commands without making them part of the image.
    proxies = [word for key in PROXIES if os.environ.get(key) for word in ("--build-arg", key)]
    return ["docker", "build", "-f", file, *options, *proxies, context]


def source_hash() -> str:
    """Returns a hash of everything in the checkout that the image is built from."""
    found = hashlib.sha256()
    files = [ROOT / part for part in _PARTS]
    files += (
        path
        for path in (ROOT / "catkin_ws" / "src").rglob("*")
        if path.is_file() and not path.is_symlink()
    )
    for path in sorted(files):
        inside = path.relative_to(ROOT)
        if "__pycache__" not in inside.parts and "test" not in inside.parts:
            found.update(f"{inside} {path.stat().st_mode & 0o111}\n".encode())
            found.update(path.read_bytes())
    return found.hexdigest()[:32]


def _label(image: str) -> str:
    template = f'{{{{index .Config.Labels "{LABEL}"}}}}'
    answer = subprocess.run(
        ["docker", "image", "inspect", "-f", template, image],
        capture_output=True,
        text=True,
        check=False,
    )
    return answer.stdout.strip()


def requirements(name: str = "run") -> list[str]:
    """Returns what an image needs from PyPI: the section ``name`` of the requirements."""
    section = re.search(
        rf"^## {name}\n(.*?)(?=^## |\Z)", (ROOT / "requirements.txt").read_text(), re.S | re.M
    )
    lines = section[1].splitlines() if section else []
    # The image is Debian 12, with Python 3.11.
    return [
        line.partition(";")[0]
        for line in lines
        if line[:1].isalpha() and 'python_version >= "3.12"' not in line
    ]


def _python() -> Path:
    """Returns the Python whose pip downloads: that of the set-up, of the system, or the running one."""
    known = (ROOT / ".setup/venv/bin/python3", Path("/usr/bin/python3"))
    return next((path for path in known if path.exists()), Path(sys.executable))


def _pip(packages: Sequence[str]) -> list[str]:
    """Returns the command that downloads the packages.

    Raises:
        ContainerError: pip is missing.
    """
    python = str(_python())
    if subprocess.run(
        [python, "-m", "pip", "--version"], capture_output=True, check=False
    ).returncode:
        raise ContainerError(
            f"pip is missing, to fetch {', '.join(packages)}: apt install python3-pip"
        )
    return [python, "-m", "pip"]


def _ensure_wheels() -> None:
    have = {
        path.name.split("-")[0].lower() + "==" + path.name.split("-")[1]
        for path in WHEELS.glob("*.whl")
    }
    missing = [one for one in requirements() if one.lower() not in have]
    if not missing:
        return
    pip = _pip(missing)
    WHEELS.mkdir(exist_ok=True)
    for left in WHEELS.glob(".wheel-*"):
        shutil.rmtree(left)
    for one in missing:
        say(f"fetching {one}")
        # A command that is killed while it writes a wheel must not leave half of it among the whole ones.
        with tempfile.TemporaryDirectory(dir=WHEELS, prefix=".wheel-") as folder:
            try:
                run_step([*pip, "download", *_CHOICE, "-d", folder, one])
            except ContainerError:
                # PyPI has only xacro's source; its wheel has no compiled parts and fits every Python.
                run_step([*pip, "wheel", "--no-deps", "-w", folder, one])
            for path in Path(folder).glob("*.whl"):
                os.replace(path, WHEELS / path.name)


def run_step(command: Sequence[str], log: Path = LOG) -> None:
    """Runs a command with its output in ``log`` and shows its progress."""
    started, shown = time.monotonic(), 0.0
    with (
        log.open("a") as file,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=ROOT,
        ) as process,
    ):
        assert process.stdout is not None, "it was asked for"
        lines: list[str] = []
        for line in process.stdout:
            file.write(line)
            file.flush()
            lines = [*lines[-14:], line.rstrip()]
            if time.monotonic() - shown > (0.5 if sys.stdout.isatty() else 20.0):
                shown = time.monotonic()
                say(f"  {shown - started:4.0f} s  {line.strip()[:80]}")
    if process.returncode:
        raise ContainerError(
            "\n".join([f"{' '.join(command[:2])} failed:", *lines, f"the whole log is {log}"])
        )
