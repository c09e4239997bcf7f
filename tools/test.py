"""Runs every check of the project, quick ones first: one line a stage, one closing line.

Each stage is a list of checks; a check is a command, and where it writes JUnit results those are
counted, else it counts as one. The checks of a stage run side by side, one more than there are processors, since each
waits for a good part of its time, unless they share something. Logs and results go to .setup/log/test/.
"""

import argparse
import contextlib
import fcntl
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from affected import ChangeError, affected, changed_files, modules_below
from checks import LOG, ROOT, Check, Count, TestCase, cases_of, run
from containers.engine import ContainerError, compose_command
from pioneer_harness.proc import processors
from text_check import CHECKS

SOURCE = ROOT / "catkin_ws" / "src"
VENV = ROOT / ".setup" / "venv" / "bin"
LAUNCH_FILES = ROOT / "tools" / "test" / "test_launch_files.py"
SHOWN_LINES = 25
MOST_AT_ONCE = 4
LONGEST = "scenario"
"""The rostest that takes longest."""
LONG = {
    "soak": "what takes long: tests of minutes, a fault every 20 s for --minutes",
    "fuzz": "hostile input for --minutes at a fleet that drives",
}
"""Options that run something else instead of the stages."""
QUICK = ("lint", "types", "unit", "launch")
"""Stages of --quick: those that start no fleet."""
CHANGED = "changed"
"""Runs the unit tests that a change may affect; only on request."""
SLOWEST_SHOWN = 10
SLOW_SECONDS = 1.0
"""A test that takes less is not listed as slow [s]."""
SWARM = "swarm"
"""Folder of container tests that run only on request; also the option's name."""
CONTAINERS_ENDING_SECONDS = 60.0
"""Time for ./pioneer down, which gives containers 20 s [s]."""


def python_roots() -> list[Path]:
    """Returns the ``src`` folders that hold the packages' Python sources."""
    return sorted(
        path
        for package in SOURCE.rglob("package.xml")
        if (path := package.with_name("src")).is_dir()
    )


def lint() -> Iterator[Check]:
    """Yields the checks of formatting, lint, import layers and catkin packages."""
    yield Check("ruff check", [str(VENV / "ruff"), "check", "--no-cache", str(ROOT)])
    yield Check("ruff format", [str(VENV / "ruff"), "format", "--no-cache", "--check", str(ROOT)])
    paths = os.pathsep.join(map(str, python_roots()))
    yield Check(
        "import-linter",
        [str(VENV / "lint-imports"), "--no-cache"],
        environment={"PYTHONPATH": paths},
    )
    yield Check("catkin_lint", ["catkin_lint", "--offline", "-W1", "--strict", str(SOURCE)])
    yield Check("ros_private", [sys.executable, str(ROOT / "tools" / "ros_private.py")])
    for name in CHECKS:
        yield Check(name, [sys.executable, str(ROOT / "tools" / "text_check.py"), name])


def types() -> Iterator[Check]:
    """Yields the check of type annotations in packages and tools."""
    sources = [
        str(path)
        for root in python_roots()
        for path in sorted(root.glob("*/"))
        if path.name != "__pycache__"
    ]
    tools = [*map(str, sorted((ROOT / "tools").glob("*.py"))), str(ROOT / "tools" / "containers")]
    paths = os.pathsep.join(map(str, [*python_roots(), ROOT / "tools"]))
    command = ["mypy", "--cache-dir", str(ROOT / ".setup" / "mypy"), *sources, *tools]
    yield Check("mypy", command, environment={"MYPYPATH": paths})


def pytest_check(name: str, paths: list[Path], timeout: float = 900.0) -> Check:
    """Returns the check that runs pytest over ``paths``."""
    results = LOG / f"{name.replace('/', '-')}-results"
    command = [
        sys.executable,
        "-m",
        "pytest",
        f"--junitxml={results / 'pytest.xml'}",
        "-o",
        "junit_family=xunit1",
    ]
    return Check(name, [*command, "--durations=5", *map(str, paths)], results, timeout=timeout)


def unit() -> Iterator[Check]:
    """Yields the tests that need no ROS environment, one check per package.

    A subfolder holds tests that mostly wait for sockets: each of its files is a check, so that they wait in parallel.
    """
    for folder in sorted(path for path in SOURCE.rglob("test/unit") if path.is_dir()):
        name = f"{folder.parent.parent.name}/unit"
        for path in sorted(folder.glob("*/test_*.py")):
            yield pytest_check(f"{name}/{path.stem.removeprefix('test_')}", [path])
        tests = sorted(folder.glob("test_*.py"))
        if tests:  # a folder may be left of a package that moved, with nothing but bytecode
            yield pytest_check(name, tests)
    yield pytest_check("tools/unit", _unit_tests_of_tools())


def affected_by_change(base: str) -> Iterator[Check]:
    """Yields ruff, and the unit tests that may be affected by the files that differ from the commit ``base``.

    Raises:
        ChangeError: git cannot say what differs.
    """
    changed = [path for path in changed_files(ROOT, base) if path.suffix == ".py" and path.exists()]
    if not changed:
        return
    yield Check("ruff check", [str(VENV / "ruff"), "check", "--no-cache", *map(str, changed)])
    modules = modules_below([*python_roots(), ROOT / "tools"])
    for folder in sorted(path for path in SOURCE.rglob("test/unit") if path.is_dir()):
        name = f"{folder.parent.parent.name}/unit"
        tests = affected(sorted(folder.rglob("test_*.py")), changed, modules)
        if tests:
            yield pytest_check(name, tests)
    tests = affected(_unit_tests_of_tools(), changed, modules)
    if tests:
        yield pytest_check("tools/unit", tests)


def _unit_tests_of_tools() -> list[Path]:
    folder = ROOT / "tools" / "test"
    return [path for path in sorted(folder.glob("test_*.py")) if path != LAUNCH_FILES]


def launch() -> Iterator[Check]:
    """Yields the check that every launch file loads and that everything it starts exists."""
    yield pytest_check("launch", [LAUNCH_FILES])


def rostests() -> Iterator[Check]:
    """Yields each ``.test`` file, on its own master; the longest comes first, so as not to run alone at the end."""
    for path in sorted(
        SOURCE.rglob("test/rostest/*.test"), key=lambda path: (path.stem != LONGEST, path)
    ):
        package = next(parent for parent in path.parents if (parent / "package.xml").exists())
        name = f"{package.name}/{path.stem}"
        results = LOG / "rostest-results" / name.replace("/", "-")
        home = {
            "ROS_TEST_RESULTS_DIR": str(results),
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(LOG / "ros_home"),
        }
        yield Check(name, ["rostest", package.name, path.name], results, home, timeout=300.0)


def end_to_end_files(soak: bool) -> Iterator[tuple[str, Path]]:
    """Yields package and file of end-to-end tests: with ``soak`` those that take minutes or hours, else the others."""
    for path in sorted(SOURCE.rglob("test/e2e/test_*.py")):
        if ("pytest.mark.soak" in path.read_text()) == soak:
            yield path.parents[2].name, path


def end_to_end() -> Iterator[Check]:
    """Yields the end-to-end tests, one check per file: gateways between real processes, and the demo.

    Files that check times visible to users come last, one after the other.
    """
    files = [
        (package, path, "pytest.mark.alone" in path.read_text())
        for package, path in end_to_end_files(soak=False)
    ]
    for package, path, alone in sorted(files, key=lambda file: file[2]):
        check = pytest_check(f"{package}/{path.stem.removeprefix('test_')}", [path], timeout=1200.0)
        yield replace(check, alone=alone)


def long(name: str, minutes: float, seed: int) -> Iterator[Check]:
    """Yields long tests: a fault every 20 s for ``minutes``, or hostile input to a fleet for ``minutes``."""
    variables = {
        f"PIONEER_{name.upper()}_MINUTES": str(minutes),
        f"PIONEER_{name.upper()}_SEED": str(seed),
    }
    for package, path in end_to_end_files(soak=name == "soak"):
        check = pytest_check(
            f"{package}/{path.stem.removeprefix('test_')}", [path], timeout=60 * minutes + 1800
        )
        if name in ("soak", path.stem.removeprefix("test_")):
            command = [*check.command, "-s", *(["-m", "soak"] if name == "soak" else [])]
            yield replace(check, command=command, environment=variables, shown=True)


class StageSkipped(Exception):  # noqa: N818 - no error: what the stage needs is not on this machine
    """A stage cannot run on this machine; the text says why."""


def containers() -> Iterator[Check]:
    """Yields the tests of the tutorial's computers as containers."""
    folder = ROOT / "tools" / "test" / "containers"
    # Images come first, so that their faults are reported as such.
    yield Check(
        "containers-images", [str(ROOT / "pioneer"), "image", "--desktop", "--web"], timeout=1500.0
    )
    # Tests in a subfolder share one fleet; a file beside the subfolders has its own containers.
    for path in sorted([*folder.glob("*/"), *folder.glob("test_*.py")]):
        if path.name not in ("__pycache__", SWARM):
            yield containers_check(path)


def swarm() -> Iterator[Check]:
    """Yields tests of machine failures, for a fleet on a swarm of three engines on this machine."""
    yield containers_check(ROOT / "tools" / "test" / "containers" / SWARM)


def containers_check(path: Path) -> Check:
    """Returns the check of a file or folder of container tests."""
    check = pytest_check(f"containers-{path.stem.removeprefix('test_')}", [path], timeout=1500.0)
    return replace(check, patience=CONTAINERS_ENDING_SECONDS)


def need_docker() -> None:
    """Raises StageSkipped if no Docker engine answers."""
    try:
        compose_command()
    except ContainerError as error:
        raise StageSkipped(str(error)) from None


@dataclass(frozen=True)
class Stage:
    """A group of checks.

    ``alone``: the checks share something, so they run one after the other. ``need`` raises StageSkipped if they cannot
    run.
    """

    checks: Callable[[], Iterator[Check]]
    alone: bool = False
    need: Callable[[], None] = lambda: None


STAGES = {
    "lint": Stage(lint),
    "types": Stage(types),
    "unit": Stage(unit),
    "launch": Stage(launch),
    "rostest": Stage(rostests),
    "e2e": Stage(end_to_end),
    # They share one engine and a network with fixed addresses.
    "containers": Stage(containers, alone=True, need=need_docker),
}


def run_stage(name: str, checks: Sequence[Check], at_once: int) -> Count:
    """Runs these checks of a stage and prints its line; shows the end of the log of each failed one."""
    started = time.monotonic()
    total, failures = Count(), []
    try:
        STAGES[name].need()
    except StageSkipped as reason:
        print(f"{name:10} skipped  {reason}", flush=True)
        return Count(skipped=1)

    def progress(names: list[str], done: int) -> None:
        show_progress(f"{name}: {done} of {len(checks)} done; {', '.join(names)} …")

    for check, count in run(checks, 1 if STAGES[name].alone else at_once, progress):
        total.add(count)
        if count.failed:
            failures.append((check, count))
    show_progress("")
    print(
        f"{name:10} {'FAILED' if failures else 'ok':6}  {total}  ({time.monotonic() - started:.0f} s)",
        flush=True,
    )
    for check, count in failures:
        print(f"  {check.name}: {count.failed} failed; log: {check.log.relative_to(ROOT)}")
        print(f"  again: ./pioneer test {name} --only '{check.name}'")
        for line in check.log.read_text(errors="replace").splitlines()[-SHOWN_LINES:]:
            print(f"    {line}")
    return total


def summary(cases: Iterable[TestCase]) -> Iterator[str]:
    """Yields lines that give the reasons for skipped tests, and the slowest tests."""
    cases = list(cases)
    reasons = Counter(case.skipped for case in cases if case.skipped is not None)
    for reason, count in reasons.most_common():
        yield f"skipped {count}: {reason}"
    slowest = sorted(cases, key=lambda case: -case.seconds)[:SLOWEST_SHOWN]
    slow = [case for case in slowest if case.seconds >= SLOW_SECONDS]
    if slow:
        yield f"the slowest of {len(cases)} tests:"
    for case in slow:
        yield f"  {case.seconds:6.1f} s  {case.check}: {case.name}"


def show_progress(text: str) -> None:
    """Shows the running checks on a terminal, in its progress line."""
    if sys.stdout.isatty():
        print(f"\r\033[K{text[: os.get_terminal_size().columns - 1]}", end="", flush=True)


class AnotherRunError(Exception):
    """Another run uses this checkout's logs and results."""


@contextlib.contextmanager
def the_only_run() -> Iterator[None]:
    """Excludes other runs from this checkout's logs and results.

    Raises:
        AnotherRunError: one is under way.
    """
    LOG.mkdir(parents=True, exist_ok=True)
    with (LOG / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AnotherRunError("another test run is under way in this checkout") from None
        yield


def arguments_from(words: Sequence[str] | None) -> argparse.Namespace:
    """Returns the checked command line; --soak and --fuzz add a stage of that name."""
    parser = argparse.ArgumentParser(
        prog="./pioneer test",
        description=(__doc__ or "").splitlines()[0],
        epilog="example: ./pioneer test rostest --only amcl",
    )
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=f"one of {', '.join(STAGES)}; all by default. "
        f"{CHANGED}: only ruff and the unit tests that uncommitted changes may affect")  # fmt: skip
    parser.add_argument("--since", default="HEAD", metavar="COMMIT",
        help=f"with {CHANGED}: compare with this commit (%(default)s)")  # fmt: skip
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="only the checks whose name contains TEXT"
    )
    parser.add_argument("--jobs", type=int, default=min(int(processors()) + 1, MOST_AT_ONCE), metavar="N",
        help="checks side by side (default here: %(default)s)")  # fmt: skip
    alone = parser.add_mutually_exclusive_group()
    alone.add_argument(
        "--quick", action="store_true", help=f"only {', '.join(QUICK)}: before every commit"
    )
    for name, what in LONG.items():
        alone.add_argument(
            f"--{name}", dest="long", action="store_const", const=name, help=f"only {what}"
        )
    alone.add_argument(f"--{SWARM}", action="store_true", help="with the stage containers: only the faults of machines "
        "in a Docker Swarm, which takes long; as root")  # fmt: skip
    parser.add_argument("--minutes", type=float, metavar="N", help="of --soak (180) or --fuzz (30)")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="of --soak or --fuzz (%(default)s)"
    )
    arguments = parser.parse_args(words)
    if arguments.stages == [CHANGED]:
        STAGES[CHANGED] = Stage(lambda: affected_by_change(arguments.since))
    unknown = set(arguments.stages) - set(STAGES)
    if unknown:
        parser.error(f"no stage {', '.join(sorted(unknown))}; there are {', '.join(STAGES)}")
    name = arguments.long
    if name and arguments.stages:
        parser.error(
            f"--{name} runs only what takes long: it takes no stage, not {', '.join(arguments.stages)}"
        )
    if arguments.quick:
        if arguments.stages:
            parser.error(
                f"--quick chooses the stages itself: it takes none, not {', '.join(arguments.stages)}"
            )
        arguments.stages = list(QUICK)
    if arguments.swarm:
        if arguments.stages != ["containers"]:
            parser.error(f"--{SWARM} is for one stage: ./pioneer test containers --{SWARM}")
        STAGES["containers"] = replace(STAGES["containers"], checks=swarm)
    if arguments.jobs < 1:
        parser.error(f"--jobs must be 1 or more, not {arguments.jobs}")
    if name:
        minutes = arguments.minutes or (180.0 if name == "soak" else 30.0)
        STAGES[name] = Stage(lambda: long(name, minutes, arguments.seed))
        arguments.stages = [name]
    return arguments


def main(words: Sequence[str] | None = None) -> int:
    """Runs the stages named on the command line, all by default; returns the exit status."""
    arguments = arguments_from(words)
    try:
        stages = {
            name: [check for check in STAGES[name].checks() if arguments.only in check.name]
            for name in arguments.stages or STAGES
        }
    except ChangeError as error:
        print(error, file=sys.stderr)
        return 2
    if CHANGED in stages and not any(stages.values()):
        print(f"no Python file differs from {arguments.since}")
        return 0
    if not any(stages.values()):
        print(f"no check's name contains {arguments.only!r}", file=sys.stderr)
        return 2
    total = Count()
    try:
        with the_only_run():
            for name, checks in stages.items():
                if checks:
                    total.add(run_stage(name, checks, arguments.jobs))
    except AnotherRunError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\ninterrupted")
        return 130
    for line in summary(
        case for checks in stages.values() for check in checks for case in cases_of(check)
    ):
        print(line)
    print(total)
    return 1 if total.failed or not (total.passed or total.skipped) else 0


if __name__ == "__main__":
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.default_int_handler)
    sys.exit(main())
