"""One roslaunch process: reads its output line by line, and stops it with all its descendants."""

import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from pioneer_launch.door import Process, StartLauncher
from rocon_launch.concert import Launch

_REST = 1.0
"""Timeout for the rest of its output, and for its end after a kill [s]."""
# roslaunch sets the title of the terminal window, which it shares with others here.
_WINDOW_TITLE = re.compile(r"\x1b\]2;[^\x07]*\x07")


class RoslaunchProcess:
    """Runs one launch in its own session.

    Args:
        launch: the launch to run.
        command: the complete command line.
        environment: environment of the process.
        show: called with the title and each line of output, from a thread.
        fork: starts the command as a fork if possible; None starts a new interpreter.
    """

    def __init__(
        self,
        launch: Launch,
        command: Sequence[str],
        environment: Mapping[str, str],
        show: Callable[[str, str], None],
        fork: StartLauncher | None = None,
    ) -> None:
        self.launch = launch
        self._started, self._ended = time.monotonic(), 0.0
        reader, writer = os.pipe2(os.O_CLOEXEC)
        self._process = _started(command, environment, writer, fork)
        os.close(writer)
        self._reader = threading.Thread(target=self._read, args=(reader, show), daemon=True)
        self._reader.start()

    def _read(self, reader: int, show: Callable[[str, str], None]) -> None:
        with open(reader, "rb") as output:
            for line in output:
                text = _WINDOW_TITLE.sub("", line.decode(errors="replace")).strip("\r\n")
                if text:
                    show(self.launch.title, text)

    @property
    def status(self) -> int | None:
        """The exit status; None while it is running."""
        return self._process.poll()

    @property
    def lived(self) -> float:
        """How long it has run [s], measured until the first query after its end."""
        if self.status is not None and not self._ended:
            self._ended = time.monotonic()
        return (self._ended or time.monotonic()) - self._started

    def interrupt(self) -> None:
        """Sends SIGINT; roslaunch then stops its nodes and its master."""
        if self.status is None:
            os.kill(self._process.pid, signal.SIGINT)

    def wait(self, timeout: float) -> bool:
        """Waits up to `timeout` [s] for its end; returns whether it has ended."""
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """Shows the remaining output of a process that has ended."""
        self._reader.join(_REST)

    def kill(self, others: Sequence[int]) -> None:
        """Kills the process and `others`, its descendants."""
        for pid in (*others, self._process.pid):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.wait(_REST)

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid


def _started(
    command: Sequence[str],
    environment: Mapping[str, str],
    output: int,
    fork: StartLauncher | None,
) -> Process:
    if fork is not None:
        # The fork server belongs to this computer's main process, which ends with us and stops everything.
        forked = fork(command, environment, output)
        if forked is not None:
            return forked
    return subprocess.Popen(
        # The kernel signals roslaunch when this process is killed, and roslaunch then stops its nodes.
        ["setpriv", "--pdeathsig", "TERM", "--", *command],
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
