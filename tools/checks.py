"""Checks: commands run in their own sessions, several in parallel, and the tests that they count."""

import os
import shutil
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from pioneer_harness.error import ProcessStartError
from pioneer_harness.process import ProcessGroup

ROOT = Path(__file__).resolve().parent.parent
LOG = ROOT / ".setup" / "log" / "test"
ENDING_SECONDS = 30.0
"""Longer than roslaunch needs on a busy machine: it gives its nodes 15 s after SIGINT and 2 s after SIGTERM."""
_LOOK_SECONDS = 0.1


@dataclass(frozen=True)
class Check:
    """One command of a stage. ``results`` is the folder where it writes JUnit files, if it does.

    If it is ``shown``, the last line of its log is printed as progress. ``patience`` is the time that it and its
    descendants have to end once they are asked to [s]. An ``alone`` check never runs beside another.
    """

    name: str
    command: list[str]
    results: Path | None = None
    environment: dict[str, str] = field(default_factory=dict)
    timeout: float = 600.0
    patience: float = ENDING_SECONDS
    shown: bool = False
    alone: bool = False

    @property
    def log(self) -> Path:
        """The file that its output goes to."""
        return LOG / f"{self.name.replace('/', '-').replace(' ', '-')}.log"


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


class Running:
    """A running check; ends everything it started, including orphans and roslaunch's nodes in sessions of their own."""

    def __init__(self, check: Check) -> None:
        self.check, self.pid = check, 0
        if check.results:
            shutil.rmtree(check.results, ignore_errors=True)
            check.results.mkdir(parents=True)
        self._began, self._said = time.monotonic(), ""
        check.log.unlink(missing_ok=True)
        self._group = ProcessGroup()
        environment = {**os.environ, **check.environment}
        try:
            self.pid = self._group.start(
                check.name, check.command, environment, check.log, may_end=True, folder=ROOT
            )
        except ProcessStartError as error:
            self._log(str(error))

    def ended(self, patience: float) -> bool:
        """Waits up to ``patience`` seconds for the end; returns whether the check has ended or its time-out is over."""
        with self._group.changed:
            if self._group.changed.wait_for(
                lambda: not self._group.is_running(self.check.name), patience
            ):
                return True
        if self.check.shown:
            self._show()
        return time.monotonic() - self._began > self.check.timeout

    def close(self, urgent: Callable[[], bool] = lambda: False) -> Count:
        """Ends what still runs by SIGINT, then by SIGKILL after its patience or once ``urgent``; returns the count."""
        good = bool(self.pid) and not self._group.deaths
        if self._group.is_running(self.check.name):
            good = False
            self._log(f"not finished after {time.monotonic() - self._began:.0f} s")
        if killed := self._group.stop(self.check.patience, urgent):
            self._log("\n  ".join(("killed, because they did not end in time:", *killed)))
        return counted(self.check, 0 if good else 1)

    def _log(self, text: str) -> None:
        with self.check.log.open("a") as output:
            output.write(f"\n{text}\n")

    def _show(self) -> None:
        lines = self.check.log.read_text(errors="replace").splitlines()
        if lines and lines[-1] != self._said:
            self._said = lines[-1]
            print(f"  {self._said}", flush=True)


def _has_room(check: Check, running: Sequence[Check], at_once: int) -> bool:
    if running and (check.alone or running[0].alone):
        return False
    return len(running) < at_once


def run(
    checks: Sequence[Check], at_once: int, progress: Callable[[list[str], int], None]
) -> Iterator[tuple[Check, Count]]:
    """Runs the checks in order, ``at_once`` of them in parallel, and yields each with its count when it ends.

    ``progress`` is called with the names of the running checks and the number of those that have ended, whenever that
    changes. Closing the iterator, or an interrupt, ends all running checks; a second interrupt kills them at once.
    """
    waiting, running, done = deque(checks), list[Running](), 0
    try:
        while waiting or running:
            while waiting and _has_room(waiting[0], [one.check for one in running], at_once):
                running.append(Running(waiting.popleft()))
                progress([one.check.name for one in running], done)
            for one in running:
                if one.ended(_LOOK_SECONDS / len(running)):
                    count = one.close()
                    running.remove(one)
                    done += 1
                    yield one.check, count
                    break
            _reap({one.pid for one in running})
    except KeyboardInterrupt:
        print("\nshutting down; press Ctrl-C again to kill", flush=True)
        raise
    finally:
        _close_all(running)


def _close_all(running: Sequence[Running]) -> None:
    hurry = threading.Event()
    with ThreadPoolExecutor(len(running) or 1) as pool:
        try:
            for closed in [pool.submit(one.close, hurry.is_set) for one in running]:
                closed.result()
        except KeyboardInterrupt:
            hurry.set()


def _reap(checks: set[int]) -> None:
    """Reaps orphans that have ended; tests that look for processes would see them as zombies.

    The checks' process groups make this process the parent of all orphans. The groups themselves wait for the checks.
    """
    try:
        while (
            ended := os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        ) and ended.si_pid not in checks:
            os.waitpid(ended.si_pid, 0)
    except ChildProcessError:
        return


@dataclass(frozen=True)
class TestCase:
    """One test of a check, as its JUnit file describes it; ``skipped`` is the reason, if it was skipped."""

    __test__ = False  # for pytest, which collects classes of such a name

    check: str
    name: str
    seconds: float
    skipped: str | None = None


def cases_of(check: Check) -> Iterator[TestCase]:
    """Yields the tests in the check's JUnit files; files that cannot be read have been counted as failures."""
    for path in check.results.rglob("*.xml") if check.results else ():
        try:
            root = ElementTree.parse(path).getroot()
        except ElementTree.ParseError:
            continue
        for case in root.iter("testcase"):
            skipped = case.find("skipped")
            reason = None if skipped is None else skipped.get("message") or "no reason given"
            yield TestCase(
                check.name, case.get("name", "?"), float(case.get("time") or 0.0), reason
            )


def counted(check: Check, status: int) -> Count:
    """Counts the tests in the check's JUnit files; adds a failure if a failed check shows none, or if no test ran.

    If all tests are skipped, because this machine cannot run them, that is not a failure.
    """
    total = Count()
    for path in check.results.rglob("*.xml") if check.results else ():
        try:
            suites = list(ElementTree.parse(path).getroot().iter("testsuite"))
        except (
            ElementTree.ParseError
        ):  # rostest writes a test's output unescaped, including control characters
            total.failed += 1
            continue
        for suite in suites:
            tests, skipped = (
                int(suite.get("tests", 0)),
                int(suite.get("skipped", suite.get("skip", 0)) or 0),
            )
            failed = int(suite.get("failures", 0)) + int(suite.get("errors", 0))
            total.add(Count(tests - failed - skipped, failed, skipped))
    if not check.results and not status:
        total.passed = 1
    # If a test's node dies before its first line, rostest reports success with no tests.
    if (status or not (total.passed or total.skipped)) and not total.failed:
        total.failed = 1
    return total
