"""The node, as roslaunch starts it."""

import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from rosgraph_msgs.msg import Log

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from tcpros.client import Client

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@dataclass
class Bench:
    master: Master
    pid: int
    folder: Path

    @property
    def log(self) -> str:
        path = self.folder / "rosout.log"
        return path.read_text() if path.exists() else ""

    def publish(self, fields: str, kind: str = "rosgraph_msgs/Log") -> None:
        argv = ["rostopic", "pub", "-1", "/rosout", kind, fields]
        environment = {**os.environ, **self.master.environment}
        subprocess.run(argv, env=environment, check=True, capture_output=True, timeout=60)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Master() as master, ProcessGroup() as group:
        variables = {
            **master.environment,
            "ROS_IP": "127.0.0.1",
            "ROS_LOG_DIR": str(tmp_path),
        }
        argv = ["rosrun", "rosout", "rosout", "__name:=rosout"]
        pid = group.start("rosout", argv, variables, tmp_path / "output")
        wait_until(lambda: master.system_state()[1].get("/rosout"), "the node", START)
        yield Bench(master, pid, tmp_path)
        group.check()


def addresses(pid: int) -> set[str]:
    """Returns the addresses on which a process listens, in hexadecimal."""
    sockets = {os.readlink(path) for path in Path(f"/proc/{pid}/fd").iterdir() if path.is_symlink()}
    found = set()
    for name in ("tcp", "tcp6"):
        for row in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = row.split()
            if state == "0A" and f"socket:[{rest[5]}]" in sockets:
                found.add(local.partition(":")[0])
    return found


def test_it_listens_where_ros_ip_says(bench: Bench) -> None:
    """ROS' own rosout listened on all addresses, so that any host could end it."""
    assert addresses(bench.pid) == {"0100007F"}


def test_messages_reach_the_file_and_the_topic_of_all_messages(bench: Bench) -> None:
    with Client(bench.master.uri, "/test").subscribe("/rosout", "/rosout_agg") as every:
        bench.publish("{level: 8, name: /x, msg: it burns, file: f.py, line: 3, function: f}")
        message = Log()
        while message.msg != "it burns":
            message.deserialize(every.read_frame())
    wait_until(lambda: "ERROR /x [f.py:3(f)] [topics: ] it burns\n" in bench.log, "a line", 10)
