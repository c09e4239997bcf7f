"""All processes that a group started end with it; all others are left alone."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from pioneer_harness.accounting import Account
from pioneer_harness.error import ProcessDiedError, ProcessStartError
from pioneer_harness.process import ProcessGroup, last_lines
from pioneer_harness.wait import wait_until

SLEEP = ["sleep", "1000"]


def run_python(script):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, "-c", script],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        timeout=15,
        check=False,
    )


def is_alive(pid):
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def number_in(path):
    return path.exists() and path.read_text().strip()


def stubborn(group, folder):
    """Starts a process that ignores SIGINT and SIGTERM; returns its PID once it does."""
    ready = folder / "ready"
    pid = group.start(
        "stubborn",
        ["bash", "-c", f"trap '' INT TERM; echo 1 > {ready}; while :; do sleep 1000; done"],
    )
    wait_until(lambda: number_in(ready), "the trap", 5.0)
    return pid


@pytest.fixture
def group():
    with ProcessGroup() as group:
        yield group


def test_stop_ends_what_was_started(group):
    pid = group.start("sleeper", SLEEP)
    assert is_alive(pid)
    assert group.stop() == ()
    assert not is_alive(pid)


def test_the_end_of_a_restartable_process_is_left_to_the_caller(group):
    group.restartable = frozenset(["watcher"])
    pid = group.start("watcher", SLEEP)
    os.kill(pid, signal.SIGKILL)
    deaths = []
    wait_until(lambda: deaths.extend(group.take_restartable_deaths()) or deaths, "the end", 5.0)
    group.check()
    assert [death.headline for death in deaths] == [f"watcher (pid {pid}) was killed by SIGKILL"]
    assert group.take_restartable_deaths() == []


def test_a_process_that_ignores_sigint_is_killed_after_the_grace(group, tmp_path):
    pid = stubborn(group, tmp_path)
    started = time.monotonic()
    killed = group.stop(grace=0.3)
    assert any("trap" in line for line in killed)
    assert not is_alive(pid)
    assert time.monotonic() - started < 3.0


def test_a_process_that_is_ending_as_the_grace_ends_did_not_have_to_be_killed(
    group, tmp_path, monkeypatch
):
    """A demo used to fail with "had to be killed at the end: " and an empty list."""
    pid = stubborn(group, tmp_path)
    monkeypatch.setattr(
        "pioneer_harness.process.arguments", lambda _: ()
    )  # as once its memory is freed
    assert group.stop(grace=0.3) == ()
    assert not is_alive(pid)


def test_an_urgent_stop_does_not_wait_for_the_grace(group, tmp_path):
    stubborn(group, tmp_path)
    started = time.monotonic()
    assert group.stop(grace=60.0, urgent=lambda: time.monotonic() - started > 0.1)
    assert time.monotonic() - started < 5.0


def test_orphans_in_a_session_of_their_own_end_too(group, tmp_path):
    noted = tmp_path / "pid"
    script = f"setsid bash -c 'trap \"\" INT TERM; echo $$ > {noted}; while :; do sleep 1000; done' & sleep 0.01"
    group.start("parent", ["bash", "-c", script], may_end=True)
    orphan = int(wait_until(lambda: number_in(noted), "the orphan", 5.0))
    wait_until(lambda: not group.is_running("parent"), "the parent's end", 5.0)
    assert is_alive(orphan)
    group.stop(grace=0.2)
    assert not is_alive(orphan)


def test_what_an_ended_process_left_behind_is_asked_before_it_is_killed(group, tmp_path):
    noted, asked = tmp_path / "pid", tmp_path / "asked"
    trap = f"trap 'echo 1 > {asked}; exit' INT; echo $$ > {noted}; while :; do sleep 0.01; done"
    # SIGINT is ignored in a shell's background job, and a trap in the job cannot change that.
    script = f'setsid env --default-signal=INT bash -c "{trap}" & sleep 0.01'
    group.start("parent", ["bash", "-c", script], may_end=True)
    orphan = int(wait_until(lambda: number_in(noted), "the orphan", 5.0))
    wait_until(lambda: not group.is_running("parent"), "the parent's end", 5.0)
    assert group.stop(grace=10.0) == ()
    assert not is_alive(orphan)
    assert asked.exists()


def test_orphans_of_a_group_inside_end_with_the_outer_one(group, tmp_path):
    noted = tmp_path / "pid"
    orphan = f"trap '' INT TERM; echo $$ > {noted}; while :; do sleep 1000; done"
    script = textwrap.dedent(f"""
        import os, pathlib, signal
        from pioneer_harness.process import ProcessGroup
        from pioneer_harness.wait import wait_until
        noted = pathlib.Path({str(noted)!r})
        ProcessGroup().start("inner", ["setsid", "--wait", "bash", "-c", {orphan!r}])
        wait_until(lambda: noted.exists() and noted.read_text(), "the orphan to be", 5.0)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    group.start("outer", [sys.executable, "-c", script], environment, may_end=True)
    pid = int(wait_until(lambda: number_in(noted), "the orphan", 10.0))
    wait_until(lambda: not group.is_running("outer"), "the outer's end", 5.0)
    assert is_alive(pid)
    assert any("trap" in line for line in group.stop(grace=0.2))
    assert not is_alive(pid)


def test_a_process_runs_in_the_folder_it_is_given(group, tmp_path):
    group.start("writer", ["touch", "here"], may_end=True, folder=tmp_path)
    wait_until(lambda: (tmp_path / "here").exists(), "its file", 5.0)


def test_processes_of_others_are_left_alone(group):
    with subprocess.Popen(SLEEP, start_new_session=True) as outsider:
        with ProcessGroup() as other:
            foreign = other.start("theirs", SLEEP)
            group.start("ours", SLEEP)
            group.stop()
            assert is_alive(foreign)
            assert outsider.poll() is None
        outsider.kill()


def test_an_unexpected_end_is_noticed_and_told_with_its_last_lines(group, tmp_path):
    log = tmp_path / "robot.log"
    group.start("robot", ["bash", "-c", "echo the wheel fell off; exit 3"], log=log)
    wait_until(lambda: group.deaths, "the death", 5.0, group.changed)
    with pytest.raises(
        ProcessDiedError, match=r"robot \(pid \d+\) ended, status 3(.|\n)*the wheel fell off"
    ):
        group.check()


def test_a_killed_process_is_reported_with_its_signal(group):
    os.kill(group.start("victim", SLEEP), signal.SIGKILL)
    (death,) = wait_until(lambda: group.deaths, "the death", 5.0, group.changed)
    assert "victim" in str(death)
    assert "SIGKILL" in str(death)


def test_a_process_that_may_end_is_no_death_unless_it_fails(group):
    group.start("good", ["true"], may_end=True)
    group.start("bad", ["false"], may_end=True)
    wait_until(
        lambda: not group.is_running("good") and not group.is_running("bad"),
        "both ends",
        5.0,
        group.changed,
    )
    assert [death.name for death in group.deaths] == ["bad"]


def test_processes_ended_by_stop_are_no_deaths(group):
    group.start("sleeper", SLEEP)
    group.stop()
    assert group.deaths == ()


def test_an_unknown_program_is_one_line(group):
    with pytest.raises(ProcessStartError, match="gazebo: no program 'no-such-program' on the PATH"):
        group.start("gazebo", ["no-such-program"])


def test_sigint_reaches_processes_though_our_shell_ignored_it(tmp_path):
    script = textwrap.dedent("""
        import signal
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        from pioneer_harness.process import ProcessGroup
        with ProcessGroup() as group:
            group.start("sleeper", ["sleep", "1000"])
            print(group.stop(grace=20.0))
    """)
    done = run_python(script)
    assert done.stdout == "()\n"


def test_children_end_when_this_process_is_killed(tmp_path):
    script = textwrap.dedent("""
        import os, signal
        from pioneer_harness.process import ProcessGroup
        print(ProcessGroup().start("sleeper", ["sleep", "1000"]), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    done = run_python(script)
    pid = int(done.stdout)
    wait_until(lambda: not is_alive(pid), "the child's end", 5.0)


def test_cpu_of_running_and_ended_children_is_counted_by_kind(group, tmp_path):
    account = Account(lambda argv: "worker" if "worker" in argv else "other")
    busy = "import time\nwhile time.process_time() < 0.35: pass\nprint('done', flush=True)\ntime.sleep(1000)"
    log = tmp_path / "log"
    group.start("busy", [sys.executable, "-c", busy, "worker"], log=log)
    wait_until(lambda: log.read_text(), "the work", 15.0)
    group.sample(account)
    usage = account.usage()["worker"]
    assert 0.3 <= usage.cpu < 1.0
    assert usage.processes == 1
    assert usage.rss > 1e6


def test_last_lines_of_a_missing_file_are_empty(tmp_path):
    assert last_lines(tmp_path / "none") == ""
