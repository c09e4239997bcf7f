"""How a session's command handles Ctrl-C."""

import contextlib
import signal
import subprocess
import sys

REPEAT = 0.002
"""Key repeat period [s]: the shorter it is, the likelier a signal arrives during the shutdown."""
MOST = 30_000

PROGRAM = """
import sys
from pioneer_gazebo.fleet.session import run_session

def body(session):
    session.say("runs")
    session.spin()

sys.exit(run_session("session", body))
"""


def test_a_held_ctrl_c_does_not_interrupt_the_end_of_a_session() -> None:
    command = [sys.executable, "-c", PROGRAM]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None, "it was asked for"
        assert process.stderr is not None, "it was asked for"
        assert process.stdout.readline() == "session: runs\n"
        presses = 0
        while process.returncode is None:
            process.send_signal(signal.SIGINT)
            presses += 1
            assert presses < MOST, "it does not end"
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(REPEAT)
        assert not process.stderr.read()
    assert process.returncode == 0
