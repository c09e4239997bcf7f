"""Runs a ROS master in a separate process, which can be killed, restarted, or run on another machine."""

import os
import signal
from collections.abc import Sequence
from pathlib import Path

from pioneer_harness.masters import MasterClient, environment, is_running
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until


class MasterProcess(MasterClient):
    """Has the interface of `pioneer_harness.masters.Master`; ends with its group.

    Args:
        group: the process group that starts it.
        port: its TCP port.
        folder: for its log and its nodes' logs.
        host: its address.
        prefix: command prefix that runs it elsewhere, such as in a network namespace.
    """

    def __init__(
        self, group: ProcessGroup, port: int, folder: Path, host: str = "127.0.0.1", prefix: Sequence[str] = ()
    ) -> None:
        super().__init__(f"http://{host}:{port}/")
        self.environment = {**os.environ, **environment(self.uri, folder), "ROS_IP": host}
        self._argv = [*prefix, "rosmaster", "--core", "-p", str(port)]
        self._group, self._log = group, folder / "master.log"
        self._pid = self._start()

    def _start(self) -> int:
        pid = self._group.start("master", self._argv, self.environment, self._log, may_end=True)
        wait_until(lambda: is_running(self.uri), f"the master {self.uri}", START)
        return pid

    def restart(self) -> None:
        """Kills the master and starts it again without any state."""
        os.kill(self._pid, signal.SIGKILL)
        wait_until(lambda: not is_running(self.uri), "the master's end", 5)
        self._pid = self._start()

    def stop(self) -> None:
        """Closes our connections; the process itself ends with its group."""
        self.close_clients()
