"""The steps of one computer start together and end together."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-c", "from pioneer_node.nodes.computer import main; raise SystemExit(main())"]
WAITS = """sh -c 'trap "echo interrupted; exit 0" INT; echo started; while :; do sleep 0.05; done'"""


@pytest.mark.parametrize(("status", "expected"), [(3, 3), (0, 1)], ids=["by its status", "success is a failure, too"])
def test_end_of_a_step_interrupts_the_others(tmp_path: Path, status: int, expected: int) -> None:
    ready = tmp_path / "ready"
    waits = WAITS.replace("echo started", f"touch {ready}")
    ends = f"sh -c 'until test -e {ready}; do sleep 0.05; done; exit {status}'"
    done = subprocess.run([*COMMAND, waits, ends], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (expected, "interrupted\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_ends_all_steps_with_success(number: signal.Signals) -> None:
    process = subprocess.Popen([*COMMAND, WAITS, WAITS], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert [process.stdout.readline() for _ in range(2)] == ["started\n"] * 2
    process.send_signal(number)
    assert process.communicate(timeout=60)[0] == "interrupted\n" * 2
    assert process.returncode == 0


def test_no_steps_are_a_usage_error() -> None:
    done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "usage" in done.stderr
