"""How checks run: in parallel, terminated completely, and counted."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import checks
from checks import Check, Count, run
from pioneer_harness.proc import process_state
from pioneer_harness.wait import wait_until


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(checks, "LOG", tmp_path)
    return tmp_path


def python(name: str, program: str, timeout: float = 60.0) -> Check:
    return Check(name, [sys.executable, "-c", program], timeout=timeout)


def meeting(own: Path, other: Path) -> str:
    """Returns a program that succeeds only if the other one runs at the same time."""
    return f"""
import pathlib, time
pathlib.Path({str(own)!r}).touch()
end = time.monotonic() + 10
while not pathlib.Path({str(other)!r}).exists():
    assert time.monotonic() < end
"""


def quiet(names: list[str], done: int) -> None:
    pass


def test_two_at_once_run_at_the_same_time_and_progress_names_both(tmp_path: Path) -> None:
    a, b, seen = tmp_path / "a", tmp_path / "b", []
    both = [python("a", meeting(a, b)), python("b", meeting(b, a))]
    found = list(run(both, 2, lambda names, done: seen.append((tuple(names), done))))
    assert sorted(check.name for check, count in found if count == Count(passed=1)) == ["a", "b"]
    assert seen == [(("a",), 0), (("a", "b"), 0)]


def test_one_at_once_run_in_their_order(tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    program = f"open({str(trace)!r}, 'a').write('{{0}}('); import time; open({str(trace)!r}, 'a').write('{{0}})')"
    found = [
        check.name
        for check, _ in run([python(name, program.format(name)) for name in "abc"], 1, quiet)
    ]
    assert (found, trace.read_text()) == (["a", "b", "c"], "a(a)b(b)c(c)")


def test_nothing_runs_beside_a_check_that_is_alone() -> None:
    """A page that must show the fleet within 3 s used to be opened next to two other test fleets, and took 3.5 s."""
    checks = [
        Check(name, ["true"], alone=name == "timed") for name in ("one", "two", "timed", "three")
    ]
    seen = list[list[str]]()
    assert all(not count.failed for _, count in run(checks, 3, lambda names, _: seen.append(names)))
    assert [names for names in seen if "timed" in names] == [["timed"]]
    assert ["one", "two"] in seen


def test_a_failing_check_fails_and_the_others_go_on() -> None:
    found = {
        check.name: count
        for check, count in run([python("bad", "1 / 0"), python("good", "")], 2, quiet)
    }
    assert found == {"bad": Count(failed=1), "good": Count(passed=1)}


def number(path: Path) -> int:
    return int(
        wait_until(
            lambda: path.exists() and path.read_text().strip(), f"the number in {path.name}", 10
        )
    )


def node(pid: Path, on_interrupt: str) -> str:
    """Returns a shell command that runs in its own session, like the nodes of a roslaunch."""
    inside = f"trap '{on_interrupt}' INT; echo $$ > {pid}; while :; do sleep 0.01; done"
    # SIGINT is ignored in a shell's background job, and a trap in the job cannot change that.
    return f'setsid env --default-signal=INT bash -c "{inside}"'


def endless(name: str, folder: Path, on_interrupt: str, patience: float) -> Check:
    """Returns a check that ends only on an interrupt, after it has run ``on_interrupt``."""
    program = f"trap '{on_interrupt}' INT; echo $$ > {folder / name}; while :; do sleep 0.01; done"
    return Check(name, ["bash", "-c", program], patience=patience)


def interrupted(running: Iterator[tuple[Check, Count]]) -> None:
    """Raises KeyboardInterrupt in the iterator while the checks run."""
    with pytest.raises(KeyboardInterrupt):
        running.throw(KeyboardInterrupt)  # type: ignore[attr-defined]


def test_a_check_that_does_not_end_is_stopped_with_all_its_sessions(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    check = Check(
        "endless",
        ["bash", "-c", f"trap : INT; {node(pid, ':')} & wait; wait"],
        timeout=2.0,
        patience=0.5,
    )
    assert [count for _, count in run([check], 1, quiet)] == [Count(failed=1)]
    assert "not finished after 2 s" in check.log.read_text()
    assert "killed, because they did not end in time:" in check.log.read_text()
    assert ended(number(pid))


def test_what_a_check_leaves_behind_has_time_to_end_in_order(tmp_path: Path) -> None:
    pid, tidied = tmp_path / "pid", tmp_path / "tidied"
    left = node(pid, f"sleep 0.5; touch {tidied}; exit")
    check = Check("leaves", ["bash", "-c", f"{left} & until [ -s {pid} ]; do sleep 0.01; done"])
    assert [count for _, count in run([check], 1, quiet)] == [Count(passed=1)]
    assert ended(number(pid))
    assert tidied.exists()
    assert check.log.read_text() == ""


def test_an_interrupt_asks_all_checks_at_once_and_lets_them_tidy_up(tmp_path: Path) -> None:
    # Each check ends only after the other one has been interrupted, too.
    checks = [
        endless(
            own,
            tmp_path,
            f"touch {tmp_path}/asked-{own}; until [ -e {tmp_path}/asked-{other} ]; do :; done; exit",
            60,
        )
        for own, other in ("ab", "ba")
    ]
    running = run([python("first", ""), *checks], 3, quiet)
    assert next(running)[0].name == "first"
    pids = [number(tmp_path / name) for name in "ab"]
    began = time.monotonic()
    interrupted(running)
    assert time.monotonic() - began < 30
    assert all(map(ended, pids))
    assert not any("killed" in check.log.read_text() for check in checks)


def test_a_second_interrupt_does_not_wait_for_the_checks(tmp_path: Path) -> None:
    asked = tmp_path / "asked"
    running = run([python("first", ""), endless("deaf", tmp_path, f"touch {asked}", 600)], 2, quiet)
    assert next(running)[0].name == "first"
    pid = number(tmp_path / "deaf")

    def interrupt_again() -> None:
        wait_until(asked.exists, "the first interrupt", 20)
        os.kill(os.getpid(), signal.SIGINT)

    again = threading.Thread(target=interrupt_again)
    again.start()
    interrupted(running)
    again.join()
    assert ended(pid)


def test_a_check_whose_program_is_missing_fails_with_one_line() -> None:
    check = Check("missing", ["no-such-linter"])
    assert [count for _, count in run([check], 1, quiet)] == [Count(failed=1)]
    assert check.log.read_text().strip() == "missing: no program 'no-such-linter' on the PATH"


def test_orphans_of_a_check_do_not_stay_as_zombies(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    waiting = f"until [ -s {pid} ]; do :; done; while [ -e /proc/$(cat {pid}) ]; do :; done"
    program = f"(bash -c 'echo $$ > {pid}' &); {waiting}"
    check = Check("waits for its orphan", ["bash", "-c", program], timeout=20.0)
    assert [count for _, count in run([check], 1, quiet)] == [Count(passed=1)]


def test_who_closes_the_iterator_ends_what_runs(tmp_path: Path) -> None:
    mark = tmp_path / "pid"
    program = f"import os, pathlib, time; pathlib.Path({str(mark)!r}).write_text(str(os.getpid())); time.sleep(1000)"
    first = python(
        "first", f"import os, time\nwhile not os.path.exists({str(mark)!r}): time.sleep(0.01)"
    )
    running = run([first, python("second", program)], 2, quiet)
    assert next(running)[0].name == "first"
    pid = wait_until(lambda: mark.read_text(), "the second's number", 5)
    began = time.monotonic()
    running.close()
    assert time.monotonic() - began < checks.ENDING_SECONDS
    assert ended(int(pid))


def ended(pid: int) -> bool:
    state = process_state(pid)
    return state is None or not state.alive


@pytest.mark.parametrize(
    ("text", "status", "expected"),
    [
        ('<testsuite tests="3" failures="1" errors="0" skipped="1"/>', 1, Count(1, 1, 1)),
        ('<testsuites><testsuite tests="2"/><testsuite tests="1"/></testsuites>', 0, Count(3)),
        ('<testsuite tests="2"/>', 1, Count(2, 1)),
        ('<testsuite tests="0"/>', 0, Count(0, 1)),
        ("<testsuite", 0, Count(0, 1)),
        ('<testsuite tests="5" skipped="5"/>', 0, Count(0, 0, 5)),
    ],
    ids=[
        "as they say",
        "several",
        "a status they do not show",
        "no test at all",
        "no XML",
        "none can run here",
    ],
)
def test_results_are_counted_as_junit_files_say(
    tmp_path: Path, text: str, status: int, expected: Count
) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "pytest.xml").write_text(text)
    assert checks.counted(Check("x", [], tmp_path / "results"), status) == expected
