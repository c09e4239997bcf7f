"""Real ROS masters, each on its own port: inside the test process, or as a process of their own."""

import os
import signal
import socket
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rosmaster.master

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from pioneer_launch.door import close_master_connections

_LOOPBACK = "127.0.0.1"


# The open sockets of masters that have ended would be reported in whichever test runs then.
close_master_connections()


class MasterClient:
    """Client of a master's API; ``close_clients`` closes its connections."""

    def __init__(self, uri: str) -> None:
        self.uri = uri  #: the master's address, ``http://127.0.0.1:PORT/``
        self._clients: list[rosgraph.Master] = []
        self._client = self.proxy()

    def proxy(self, name: str = "/pioneer_harness") -> rosgraph.Master:
        """Returns a client of the master's API under the node name ``name``."""
        client = rosgraph.Master(name, master_uri=self.uri)
        self._clients.append(client)
        return client

    def system_state(self) -> tuple[dict[str, list[str]], ...]:
        """Returns publishers, subscribers and services, each as a dict from topic or service to node names."""
        return tuple(dict(rows) for rows in self._client.getSystemState())

    def set_param(self, name: str, value: Any) -> None:
        """Sets a parameter by its full name."""
        self._client.setParam(name, value)

    def get_param(self, name: str) -> Any:
        """Returns a parameter by its full name; raises ``rosgraph.MasterError`` if it is not set."""
        return self._client.getParam(name)

    def close_clients(self) -> None:
        """Closes all connections to the master."""
        for client in self._clients:
            client.handle("close")()


class Master(MasterClient):
    """A private ROS master, as a context manager; several may run at once."""

    def __init__(self, port: int = 0) -> None:
        """Starts the master; port 0 picks any free port."""
        self._home = tempfile.TemporaryDirectory(prefix="pioneer-master-")
        self.home = Path(self._home.name)  #: temporary ``ROS_HOME`` (logs), removed by `stop`
        self._master = rosmaster.master.Master(port=port)
        self._master.start()
        self.port = int(self._master.master_node.port)  #: its TCP port
        super().__init__(f"http://{_LOOPBACK}:{self.port}/")

    @property
    def environment(self) -> dict[str, str]:
        """This process's environment with the master's address, for nodes that a test starts."""
        return {**os.environ, **environment(self.uri, self.home)}

    def stop(self) -> None:
        """Closes the master's port and removes its directory; a second call does nothing."""
        node = self._master.master_node
        if node is None:
            return
        self.close_clients()
        server, node.is_shutdown = node.server, True
        # rosmaster closes the socket while its server loop still uses it, which then spins. So end the loop first: a
        # connection wakes it up.
        ending = threading.Thread(target=server.shutdown)
        ending.start()
        while ending.is_alive():
            is_running(self.uri)
            ending.join(0.01)
        self._master.stop()
        self._home.cleanup()

    def __enter__(self) -> "Master":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class MasterProcess(MasterClient):
    """A ROS master in a separate process, which can be killed, restarted, or run elsewhere; ends with its group.

    Args:
        group: the process group that starts it.
        port: its TCP port.
        folder: for its log and its nodes' logs.
        host: its address.
        prefix: command prefix that runs it elsewhere, such as in a network namespace.
    """

    def __init__(
        self,
        group: ProcessGroup,
        port: int,
        folder: Path,
        host: str = "127.0.0.1",
        prefix: Sequence[str] = (),
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


def environment(uri: str, home: Path) -> dict[str, str]:
    """Returns the variables that point a ROS process of this machine at the master ``uri``, logging under ``home``."""
    return {
        "ROS_MASTER_URI": uri,
        "ROS_IP": _LOOPBACK,
        "ROS_HOME": str(home),
        "ROS_LOG_DIR": str(home / "log"),
    }


def is_running(uri: str, timeout: float = 1.0) -> bool:
    """Returns whether a server accepts connections at the master's address ``uri`` within ``timeout`` [s]."""
    try:
        socket.create_connection(rosgraph.network.parse_http_host_and_port(uri), timeout).close()
    except OSError:
        return False
    return True
