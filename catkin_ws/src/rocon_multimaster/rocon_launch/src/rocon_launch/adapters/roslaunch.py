"""One roslaunch process, with its output line by line, and its end with all its descendants."""

import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from pioneer_node.adapters.fork_server import ForkedProcess, ForkServer
from pioneer_node.core.program import early_differences
from rocon_launch.core.concert import Launch

_REST = 1.0
"""How long the rest of its output may take [s]."""
# roslaunch names the terminal's window, which is not its own here.
_WINDOW_TITLE = re.compile(r"\x1b\]2;[^\x07]*\x07")


class RoslaunchProcess:
    """Runs one launch in a session of its own.

    Args:
        launch: what to run.
        command: the whole command line.
        environment: of the process.
        show: called with the title and each line of output, from a thread.
        server: forks the command where it can; None starts an interpreter.
    """

    def __init__(
        self,
        launch: Launch,
        command: Sequence[str],
        environment: Mapping[str, str],
        show: Callable[[str, str], None],
        server: ForkServer | None = None,
    ) -> None:
        self.launch = launch
        self._started, self._ended = time.monotonic(), 0.0
        reader, writer = os.pipe2(os.O_CLOEXEC)
        self._process = _started(command, environment, writer, server)
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
        """The exit status, None while it runs."""
        return self._process.poll()

    @property
    def lived(self) -> float:
        """How long it ran [s], up to the first look at it after its end."""
        if self.status is not None and not self._ended:
            self._ended = time.monotonic()
        return (self._ended or time.monotonic()) - self._started

    def interrupt(self) -> None:
        """Asks it to end; roslaunch then ends its nodes and its master."""
        if self.status is None:
            os.kill(self._process.pid, signal.SIGINT)

    def wait(self, timeout: float) -> bool:
        """Waits [s] for its end; tells whether it came."""
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """Shows the rest of the output of a process that has ended."""
        self._reader.join(_REST)

    def kill(self, others: Sequence[int]) -> None:
        """Ends it and `others`, its descendants, without asking."""
        for pid in (*others, self._process.pid):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.wait(_REST)

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._process.pid


def _started(
    command: Sequence[str], environment: Mapping[str, str], output: int, server: ForkServer | None
) -> "subprocess.Popen[bytes] | ForkedProcess":
    forkable = os.path.isabs(command[0]) and not early_differences(os.environ, environment)
    if server is not None and forkable and not server.is_lost:
        # Of a computer whose main process ends with us, and with it everything.
        return server.start(command, environment, os.getcwd(), output, output, lend=True)
    return subprocess.Popen(
        # The kernel signals roslaunch when this process is killed, and roslaunch ends its nodes.
        ["setpriv", "--pdeathsig", "TERM", "--", *command],
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
