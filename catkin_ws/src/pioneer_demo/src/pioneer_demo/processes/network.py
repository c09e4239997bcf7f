"""Emulates faulty links: a separate network for each affected robot, with real packets that are delayed and lost.

The run has its own network namespace, plus one for each such robot. A program,
``python3 -m pioneer_demo.processes.network ROBOT…``, forwards packets between them through two TUN devices per robot.
"""

import ctypes
import dataclasses
import fcntl
import json
import os
import secrets
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pioneer_demo.error import DemoError
from pioneer_demo.scenario.link import Condition, Direction

_OWN = "PIONEER_OWN_NETWORK"
_UNSHARE = ("unshare", "--user", "--map-current-user", "--keep-caps", "--net")
_BASE = "10.77.0.1"
_NEW_NETWORK, _SET_NAME, _TUN_WITHOUT_HEADER, _DEATH_SIGNAL = 0x40000000, 0x400454CA, 0x1001, 1
_LARGEST = 65536


class NetworkError(DemoError):
    """Network namespaces or TUN devices are not available on this machine or to this user."""


def apart() -> tuple[str, ...]:
    """Returns the prefix of a command that runs it in its own network namespace.

    Raises:
        NetworkError: namespaces are not available.
    """
    done = subprocess.run([*_UNSHARE, "true"], capture_output=True, text=True, check=False)
    if done.returncode or not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        reason = done.stderr.strip() or "/dev/net/tun cannot be opened"
        raise NetworkError(f"faults of links need user namespaces and TUN devices: {reason}")
    return _UNSHARE


def enter(words: Sequence[str]) -> None:
    """Moves this process into its own network namespace: it executes itself again there with these arguments.

    Raises:
        NetworkError: namespaces are not available.
    """
    if _OWN in os.environ:
        _ip("link", "set", "lo", "up")
        return
    prefix = apart()
    os.execvpe(
        prefix[0],
        [*prefix, sys.executable, "-m", "pioneer_demo", *words],
        {**os.environ, _OWN: "1"},
    )


class Networks:
    """The networks of a run's robots with faulty links; does nothing without robots. Not thread-safe."""

    def __init__(self, robots: Sequence[str], hub_port: int) -> None:
        """Sets up the networks.

        Raises:
            NetworkError: the system refuses.
        """
        self._robots, self._holders = list(robots), dict[str, int]()
        if not robots:
            return
        self._shared = {
            "GATEWAY_HUB_URI": f"http://{_BASE}:{hub_port}", "ROCON_HUB_PASSWORD": secrets.token_hex(), "ROS_IP": _BASE,
        }  # fmt: skip
        self._program = subprocess.Popen(
            [sys.executable, "-m", "pioneer_demo.processes.network", *robots], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        assert self._program.stdout, "it is a pipe"
        assert self._program.stderr, "it is a pipe"
        if not (line := self._program.stdout.readline()):
            raise NetworkError(
                f"the robots' networks cannot be set up: {self._program.stderr.read().strip()[-500:]}"
            )
        self._holders = json.loads(line)

    def placed(self, robot: str, argv: Sequence[str]) -> list[str]:
        """Returns a command line that runs ``argv`` on a robot's computer; an empty name means the base station."""
        if robot not in self._holders:
            return list(argv)
        return ["nsenter", f"--net=/proc/{self._holders[robot]}/ns/net", "--", *argv]

    def environment(self, robot: str) -> dict[str, str]:
        """Returns additional environment variables for processes on a robot's computer."""
        if not self._holders:
            return {}
        return {
            **self._shared,
            **({"ROS_IP": _address(self._robots.index(robot))} if robot in self._holders else {}),
        }

    def set(self, robot: str, condition: Condition) -> None:
        """Sets the condition of a robot's link.

        Raises:
            NetworkError: the forwarding program has ended.
        """
        assert self._program.stdin, "it is a pipe"
        try:
            self._program.stdin.write(json.dumps([robot, dataclasses.asdict(condition)]) + "\n")
            self._program.stdin.flush()
        except OSError as error:
            raise NetworkError(f"the robots' networks have ended: {error}") from None

    def close(self) -> None:
        """Removes the networks."""
        if self._holders:
            self._holders = {}
            self._program.communicate()


def _address(index: int) -> str:
    return f"10.77.{index + 1}.2"


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NetworkError(f"ip {' '.join(words)}: {done.stderr.strip()}")


def _device(name: str) -> int:
    """Returns the file descriptor of a new TUN device in this process's network."""
    device = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(device, _SET_NAME, struct.pack("16sH22x", name.encode(), _TUN_WITHOUT_HEADER))
    _ip("link", "set", name, "up")
    return device


def _hold(address: str, channel: socket.socket) -> None:
    """Holds a new network namespace until the parent ends; sends its TUN device on ``channel``."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_DEATH_SIGNAL, signal.SIGKILL)
    if libc.unshare(_NEW_NETWORK):
        raise NetworkError(f"unshare: {os.strerror(ctypes.get_errno())}")
    _ip("link", "set", "lo", "up")
    device = _device("base")
    _ip("address", "add", address, "dev", "base")
    _ip("route", "add", "default", "dev", "base", "src", address)
    socket.send_fds(channel, [b"."], [device])
    signal.pause()


def _connected(index: int) -> tuple[int, int, int]:
    """Sets up a robot's network; returns its holder's PID, its TUN device and the base station's device towards it."""
    own, other = socket.socketpair()
    if not (holder := os.fork()):
        try:
            _hold(_address(index), other)
        except NetworkError as error:
            print(error, file=sys.stderr, flush=True)
        finally:
            os._exit(1)
    other.close()
    _, (device, *_), _, _ = socket.recv_fds(own, 1, 1)
    towards = _device(f"robot{index + 1}")
    _ip("route", "add", _address(index), "dev", f"robot{index + 1}", "src", _BASE)
    return holder, device, towards


def _carry(robots: Sequence[str]) -> None:
    """Forwards packets until standard input is closed; lines on standard input set link conditions."""
    _ip("address", "add", f"{_BASE}/32", "dev", "lo")
    Path("/proc/sys/net/ipv4/ip_forward").write_text("1")
    holders, ways = dict[str, int](), dict[int, tuple[int, Direction]]()
    links = dict[str, tuple[Direction, Direction]]()
    for index, robot in enumerate(robots):
        holders[robot], device, towards = _connected(index)
        links[robot] = there, back = Direction(2 * index), Direction(2 * index + 1)
        ways |= {towards: (device, there), device: (towards, back)}
    print(json.dumps(holders), flush=True)
    while True:
        due = [way.due for _, way in ways.values() if way.due is not None]
        ready, _, _ = select.select(
            [0, *ways], [], [], max(0.0, min(due) - time.monotonic()) if due else None
        )
        now = time.monotonic()
        for file in ready:
            if file:
                ways[file][1].send(now, os.read(file, _LARGEST))
                continue
            lines = os.read(file, _LARGEST).splitlines()
            if not lines:
                return
            for robot, condition in map(json.loads, lines):
                for way in links[robot]:
                    way.condition = Condition(**condition)
        for device, way in ways.values():
            for packet in way.arrived(now):
                os.write(device, packet)


if __name__ == "__main__":
    _carry(sys.argv[1:])
