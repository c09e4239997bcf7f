"""Runs every check of the project, quick ones first: one line a stage, one closing line.

Each stage is a list of checks; a check is a command, and where it writes JUnit results those are
counted, else it counts as one. Logs and results go to .setup/log/test/.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "catkin_ws" / "src"
LOG = ROOT / ".setup" / "log" / "test"
VENV = ROOT / ".setup" / "venv" / "bin"
SHOWN_LINES = 25
ENDING_SECONDS = 10.0


@dataclass(frozen=True)
class Check:
    """One command of a stage. ``results`` is the folder where it leaves JUnit files, if it does.

    The last line of a check that is ``shown`` is its progress, for people to see.
    """

    name: str
    command: list[str]
    results: Path | None = None
    environment: dict[str, str] = field(default_factory=dict)
    timeout: float = 600.0
    shown: bool = False


@dataclass
class Count:
    """How many tests passed, failed and were skipped."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0

    def add(self, other: "Count") -> None:
        """Adds ``other`` to this count."""
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped

    def __str__(self) -> str:
        skipped = f", {self.skipped} skipped" if self.skipped else ""
        return f"{self.passed} passed, {self.failed} failed{skipped}"


def packages() -> list[Path]:
    """Returns the folders of all packages of the workspace."""
    return sorted(path.parent for path in SOURCE.rglob("package.xml"))


def python_roots() -> list[Path]:
    """Returns the ``src`` folders that hold the packages' Python sources."""
    return [package / "src" for package in packages() if (package / "src").is_dir()]


def lint() -> Iterator[Check]:
    """Format, lint, the layers between modules, and the catkin packages."""
    yield Check("ruff check", [str(VENV / "ruff"), "check", "--no-cache", str(ROOT)])
    yield Check("ruff format", [str(VENV / "ruff"), "format", "--no-cache", "--check", str(ROOT)])
    paths = os.pathsep.join(map(str, python_roots()))
    yield Check("import-linter", [str(VENV / "lint-imports"), "--no-cache"], environment={"PYTHONPATH": paths})
    yield Check("catkin_lint", ["catkin_lint", "--offline", "-W1", "--strict", str(SOURCE)])
    yield Check("file length", [sys.executable, str(ROOT / "tools" / "file_length.py")])


def types() -> Iterator[Check]:
    """The cores are fully annotated."""
    cores = [str(core) for root in python_roots() for core in sorted(root.glob("*/core"))]
    paths = os.pathsep.join(map(str, python_roots()))
    cache = str(ROOT / ".setup" / "mypy")
    yield Check("mypy", ["mypy", "--cache-dir", cache, *cores], environment={"MYPYPATH": paths})


def pytest_check(name: str, paths: list[Path], timeout: float = 900.0) -> Check:
    """Returns the check that runs pytest over ``paths``."""
    results = LOG / f"{name}-results"
    command = [sys.executable, "-m", "pytest", f"--junitxml={results / 'pytest.xml'}", "-o", "junit_family=xunit1"]
    return Check(name, [*command, "--durations=5", *map(str, paths)], results, timeout=timeout)


def unit() -> Iterator[Check]:
    """Tests without a ROS environment of their own."""
    folders = sorted(path for path in SOURCE.rglob("test/unit") if path.is_dir())
    tools = ROOT / "tools" / "test"
    yield pytest_check("unit", [*folders, tools / "test_setup.py", tools / "test_containers.py"])


def launch() -> Iterator[Check]:
    """Every launch file of every package loads, and what it starts exists."""
    yield pytest_check("launch", [ROOT / "tools" / "test" / "test_launch_files.py"])


def rostests() -> Iterator[Check]:
    """Each ``.test`` file, on a master of its own."""
    for path in sorted(SOURCE.rglob("test/rostest/*.test")):
        package = next(parent for parent in path.parents if (parent / "package.xml").exists())
        name = f"{package.name}/{path.stem}"
        results = LOG / "rostest-results" / name.replace("/", "-")
        home = {"ROS_TEST_RESULTS_DIR": str(results), "ROS_IP": "127.0.0.1", "ROS_HOME": str(LOG / "ros_home")}
        yield Check(name, ["rostest", package.name, path.name], results, home, timeout=300.0)


def end_to_end() -> Iterator[Check]:
    """Several masters: the gateways between real processes, and the demo itself."""
    for path in sorted(SOURCE.rglob("test/e2e")):
        yield pytest_check(f"{path.parent.parent.name}-e2e", [path], timeout=1200.0)


def soak(minutes: float, seed: int) -> Iterator[Check]:
    """Tests that take long, and a fault every 20 s for so many minutes."""
    variables = {"PIONEER_SOAK_MINUTES": str(minutes), "PIONEER_SOAK_SEED": str(seed)}
    for path in sorted(SOURCE.rglob("test/e2e")):
        if not any("pytest.mark.soak" in file.read_text() for file in path.glob("*.py")):
            continue
        check = pytest_check(f"{path.parent.parent.name}-soak", [path], timeout=60 * minutes + 1800)
        command = [*check.command, "-m", "soak", "-s"]
        yield replace(check, command=command, environment=variables, shown=True)


class StageSkipped(Exception):  # noqa: N818 - no error: what the stage needs is not on this machine
    """A stage cannot run here; the text says why."""


def containers() -> Iterator[Check]:
    """The tutorial's computers as containers, where a Docker engine answers."""
    sys.path.insert(0, str(ROOT / "tools"))
    from containers.engine import ContainerError, compose_command

    try:
        compose_command()
    except ContainerError as error:
        raise StageSkipped(str(error)) from None
    for path in sorted((ROOT / "tools" / "test" / "containers").glob("test_*.py")):
        yield pytest_check(f"containers-{path.stem.removeprefix('test_')}", [path], timeout=1500.0)


STAGES: dict[str, Callable[[], Iterator[Check]]] = {
    "lint": lint,
    "types": types,
    "unit": unit,
    "launch": launch,
    "rostest": rostests,
    "e2e": end_to_end,
    "containers": containers,
}


def run(check: Check) -> tuple[Count, Path]:
    """Runs one check in a session of its own, which is ended whole, and returns its count and its log."""
    log = LOG / f"{check.name.replace('/', '-').replace(' ', '-')}.log"
    environment = {**os.environ, **check.environment}
    if check.results:
        shutil.rmtree(check.results, ignore_errors=True)
        check.results.mkdir(parents=True)
    with log.open("w") as output:
        process = subprocess.Popen(
            check.command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
            env=environment,
            start_new_session=True,
        )
        try:
            status = wait(process, check, log)
        except subprocess.TimeoutExpired:
            output.write(f"\nnot finished after {check.timeout:.0f} s\n")
            status = 1
        finally:
            end_session(process)
    return counted(check, status), log


def wait(process: "subprocess.Popen[bytes]", check: Check, log: Path) -> int:
    """Waits for the check's end, showing its progress if it wants that; returns its status."""
    if not check.shown:
        return process.wait(check.timeout)
    deadline, said = time.monotonic() + check.timeout, ""
    while time.monotonic() < deadline:
        try:
            return process.wait(1.0)
        except subprocess.TimeoutExpired:
            lines = log.read_text(errors="replace").splitlines()
            if lines and lines[-1] != said:
                said = lines[-1]
                print(f"  {said}", flush=True)
    raise subprocess.TimeoutExpired(check.command, check.timeout)


def end_session(process: "subprocess.Popen[bytes]") -> None:
    """Ends what is left of the check's processes: asks first, insists after."""
    for number in (signal.SIGINT, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(ENDING_SECONDS)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def counted(check: Check, status: int) -> Count:
    """Returns the tests in the check's JUnit files; a failure they do not show, or no test at all, is one more."""
    total = Count()
    for path in check.results.rglob("*.xml") if check.results else ():
        try:
            suites = list(ElementTree.parse(path).getroot().iter("testsuite"))
        except ElementTree.ParseError:  # rostest writes what a test printed as it came, control characters too
            total.failed += 1
            continue
        for suite in suites:
            tests, skipped = int(suite.get("tests", 0)), int(suite.get("skipped", suite.get("skip", 0)) or 0)
            failed = int(suite.get("failures", 0)) + int(suite.get("errors", 0))
            total.add(Count(tests - failed - skipped, failed, skipped))
    if not check.results and not status:
        total.passed = 1
    # rostest calls a test whose node died before its first line a success of no tests.
    if (status or not total.passed) and not total.failed:
        total.failed = 1
    return total


def run_stage(name: str, only: str) -> Count:
    """Runs the checks of a stage and prints its line; shows the end of the log of each that failed."""
    started = time.monotonic()
    total, failures = Count(), []
    try:
        checks = list(STAGES[name]())
    except StageSkipped as reason:
        print(f"{name:10} skipped  {reason}", flush=True)
        return Count(skipped=1)
    for check in checks:
        if only and only not in check.name:
            continue
        show_progress(f"{name}: {check.name} …")
        count, log = run(check)
        total.add(count)
        if count.failed:
            failures.append((check, count, log))
    show_progress("")
    print(f"{name:10} {'FAILED' if failures else 'ok':6}  {total}  ({time.monotonic() - started:.0f} s)", flush=True)
    for check, count, log in failures:
        print(f"  {check.name}: {count.failed} failed; log: {log.relative_to(ROOT)}")
        for line in log.read_text(errors="replace").splitlines()[-SHOWN_LINES:]:
            print(f"    {line}")
    return total


def show_progress(text: str) -> None:
    """Shows what runs now, on a terminal."""
    if sys.stdout.isatty():
        print(f"\r\033[K{text}", end="", flush=True)


def main() -> int:
    """Runs the stages named on the command line, all by default; returns the exit status."""
    parser = argparse.ArgumentParser(prog="./pioneer test", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=f"one of {', '.join(STAGES)}; all by default")
    parser.add_argument("--only", default="", metavar="TEXT", help="only the checks whose name contains TEXT")
    parser.add_argument(
        "--soak", action="store_true", help="only what takes long: tests of minutes, faults for --minutes"
    )
    parser.add_argument("--minutes", type=float, default=180.0, metavar="N", help="of faults with --soak (%(default)g)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="which faults with --soak (%(default)s)")
    arguments = parser.parse_args()
    if arguments.soak:
        STAGES["soak"] = lambda: soak(arguments.minutes, arguments.seed)
        arguments.stages = arguments.stages or ["soak"]
    unknown = set(arguments.stages) - set(STAGES)
    if unknown:
        parser.error(f"no stage {', '.join(sorted(unknown))}; there are {', '.join(STAGES)}")
    LOG.mkdir(parents=True, exist_ok=True)
    total = Count()
    try:
        for name in arguments.stages or STAGES:
            total.add(run_stage(name, arguments.only))
    except KeyboardInterrupt:
        print("\ninterrupted")
        return 130
    print(total)
    return 1 if total.failed or not (total.passed or total.skipped) else 0


if __name__ == "__main__":
    sys.exit(main())
