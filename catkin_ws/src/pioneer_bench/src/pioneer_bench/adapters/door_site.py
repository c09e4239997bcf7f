"""A master with stand-ins for a fleet's topics, a door or a bridge to ROS 2, and nodes of rclpy."""

import contextlib
import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

import rospkg

from pioneer_bench.adapters.fleet import PATIENCE, Process, cpu, find_program, module_argv
from pioneer_bench.core.door import DOOR, Stream
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup, last_lines
from pioneer_harness.wait import wait_until

ROOT = Path(rospkg.RosPack().get_path("pioneer_bench")).parents[2]
PEER = ROOT / ".setup" / "ros2-peer" / "bin" / "python3"
"""The interpreter with rclpy."""
_PROGRAMS = Path(__file__).parents[1] / "ros2_peer"
_DISCOVERY = (
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "CYCLONEDDS_URI",
)
_FIRST_DOMAIN, _DOMAINS = 2, 98
"""From 130 on, the ports of a domain are among those that the kernel gives to any socket."""


class DoorSite:
    """A master, and what the bench starts beside it.

    Args:
        folder: for the logs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._master = Master()
        self._group = ProcessGroup()
        self._number = count()
        # A domain that other programs on this machine hardly use.
        domain = str(_FIRST_DOMAIN + os.getpid() % _DOMAINS)
        ros1 = {**self._master.environment, "ROS_DOMAIN_ID": domain, "PYTHONUNBUFFERED": "1"}
        for name in _DISCOVERY:
            ros1.pop(name, None)
        self._ros1 = ros1
        # ROS 1's path would hide the messages of ROS 2.
        self._ros2 = {name: value for name, value in ros1.items() if name != "PYTHONPATH"}

    def close(self) -> None:
        """Ends everything."""
        self._group.stop()
        self._master.stop()

    @contextlib.contextmanager
    def _running(
        self, name: str, argv: Sequence[str], is_ros2: bool = False, is_killed: bool = False
    ) -> Iterator[Process]:
        """Runs a program with the environment of ROS 1 or ROS 2; at the end kills it, or ends it in order."""
        log = self._folder / f"{next(self._number)}-{name}.log"
        environment = self._ros2 if is_ros2 else self._ros1
        process = Process(self._group.start(name, argv, environment, log, may_end=True), log)
        try:
            yield process
        finally:
            if process.lives and is_killed:
                # The group must not count it as a failure.
                self._group.kill(name)
                wait_until(lambda: not process.lives, f"the end of {name}", PATIENCE)
            elif process.lives:
                process.end()

    @contextlib.contextmanager
    def stand_in(self, streams: Sequence[Stream]) -> Iterator[None]:
        """Publishes the streams' topics in ROS 1."""
        rates: dict[str, tuple[str, float]] = {}
        for stream in streams:
            known = rates.get(stream.source, (stream.type_name, 0.0))[1]
            rates[stream.source] = (stream.type_name, max(stream.rate, known))
        rows = [(topic, *rest) for topic, rest in rates.items()]
        argv = module_argv("stand_in", json.dumps(rows))
        with self._running("stand_in", argv):
            wait_until(
                lambda: rates.keys() <= self._master.system_state()[0].keys(),
                "the stand-in's topics",
                PATIENCE,
            )
            yield

    @contextlib.contextmanager
    def carrier(self, way: str, streams: Sequence[Stream]) -> Iterator[Process]:
        """Runs the door with its default rules, or the bridge for the streams whose types rclpy has."""
        if way == DOOR:
            with self._running("door", [find_program("pioneer_ros2", "ros2_door")]) as process:
                yield process
            return
        rows = [
            (each.source, each.target, each.type_name, each.qos, each.own_frames)
            for each in streams
            if each.is_for_rclpy
        ]
        with self.rclpy("bridge", json.dumps(rows)) as process:
            yield process

    def bridge_conversion(self, message: Path) -> float:
        """Returns the CPU time in which the bridge converts the message in a file [s]."""
        argv = [str(PEER), str(_PROGRAMS / "bridge.py"), "convert", str(message)]
        done = subprocess.run(
            argv, env=self._ros2, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        if done.returncode:
            raise OSError(f"the bridge's conversion failed: {done.stderr}")
        return float(json.loads(done.stdout))

    @contextlib.contextmanager
    def rclpy(self, name: str, *arguments: object) -> Iterator[Process]:
        """Runs one of the programs of rclpy."""
        argv = [str(PEER), str(_PROGRAMS / f"{name}.py"), *map(str, arguments)]
        with self._running(name, argv, is_ros2=True, is_killed=True) as process:
            yield process

    @contextlib.contextmanager
    def listener(self, streams: Sequence[Stream], seconds: float) -> Iterator[Process]:
        """Runs a reader of all streams whose types rclpy has; returns once every topic was heard."""
        rows = [(each.target, each.type_name, each.qos) for each in streams if each.is_for_rclpy]
        with self.rclpy("listen", f"{seconds:g}", json.dumps(rows)) as process:
            self._await_line(process, "begin")
            yield process

    @contextlib.contextmanager
    def plain_reader(self, streams: Sequence[Stream]) -> Iterator[None]:
        """Runs a reader, without rclpy, of the streams whose types rclpy lacks; returns once every topic was heard."""
        rows = [(each.target, each.type_name) for each in streams if not each.is_for_rclpy]
        argv = module_argv("read_dds", json.dumps(rows))
        with self._running("read_dds", argv, is_killed=True) as process:
            self._await_line(process, "begin")
            yield

    @contextlib.contextmanager
    def ros1_listener(self, stream: Stream, seconds: float) -> Iterator[Process]:
        """Runs a subscriber in ROS 1 that measures latency."""
        argv = module_argv("hear", stream.source, seconds, "header")
        with self._running("hear", argv) as process:
            self._await_line(process, "begin")
            yield process

    def _await_line(self, process: Process, line: str) -> None:
        wait_until(
            lambda: line in process.lines() or not process.lives,
            f"'{line}' in {process.log.name}",
            PATIENCE,
        )
        if line not in process.lines():
            raise OSError(f"{process.log.name}: it has ended:\n{last_lines(process.log)}")


def result_of(process: Process, seconds: float) -> dict[str, float]:
    """Waits for the line of JSON that a listener prints at its end, and returns it."""
    wait_until(
        lambda: process.lines()[-1].startswith("{") or not process.lives,
        f"the end of {process.log.name}",
        seconds + PATIENCE,
    )
    last = process.lines()[-1]
    if not last.startswith("{"):
        raise OSError(f"{process.log.name}: it has ended:\n{last_lines(process.log)}")
    result: dict[str, float] = json.loads(last)
    return result


def cpu_of(process: Process) -> float:
    """Returns the CPU time of a process [s]."""
    return cpu([process.pid])


def private_memory(process: Process) -> float:
    """Returns the memory that the process shares with no other [MB]."""
    lines = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
    parts = [line.split() for line in lines if line.startswith("Private_")]
    return sum(float(part[1]) for part in parts) / 1024.0
