"""Masters and nodes that run but do not answer."""

import os
import signal
from pathlib import Path

import pytest

from pioneer_fleet.monitor.hang_watch import HangWatch
from pioneer_harness.masters import MasterProcess
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until

NODE = "/rosout of aadi1 has not answered for"
MASTER = "the ROS master of aadi1 has not answered for"


@pytest.mark.parametrize("hung", ["node", "master"])
def test_what_is_stopped_is_named_and_again_when_it_continues(tmp_path: Path, hung: str) -> None:
    with PortReservation() as ports, ProcessGroup() as group:
        master = MasterProcess(group, ports.take(21311), tmp_path)
        argv = ["rosrun", "rosout", "rosout", "__name:=rosout"]
        node = group.start("node", argv, {**os.environ, **master.environment})
        wait_until(lambda: master.system_state()[1].get("/rosout"), "the node", START)
        watch = HangWatch([f"aadi1={master.uri}"])
        lines: list[str] = []

        def news(text: str) -> bool:
            lines.extend(watch.news())
            return any(text in line for line in lines)

        try:
            wait_until(lambda: len(watch._watched) == 2, "the node to be known", START)
            assert watch.faults() == []
            pid = node if hung == "node" else master._pid
            os.kill(pid, signal.SIGSTOP)
            wait_until(lambda: news(NODE if hung == "node" else MASTER), "its name", 20)
            assert any("has not answered for" in fault for fault in watch.faults())
            os.kill(pid, signal.SIGCONT)
            wait_until(lambda: news("answers again"), "its answer", 20)
            assert watch.faults() == []
        finally:
            watch.close()
            master.stop()


def test_a_node_that_ends_is_no_node_that_hangs(tmp_path: Path) -> None:
    with PortReservation() as ports, ProcessGroup() as group:
        master = MasterProcess(group, ports.take(21311), tmp_path)
        argv = ["rosrun", "rosout", "rosout", "__name:=rosout"]
        group.start("node", argv, {**os.environ, **master.environment})
        wait_until(lambda: master.system_state()[1].get("/rosout"), "the node", START)
        watch = HangWatch([f"aadi1={master.uri}"])
        try:
            wait_until(lambda: len(watch._watched) == 2, "the node to be known", START)
            group.kill("node")
            wait_until(lambda: len(watch._watched) == 1, "the node to be forgotten", 20)
            assert watch.news() == watch.faults() == []
        finally:
            watch.close()
            master.stop()
