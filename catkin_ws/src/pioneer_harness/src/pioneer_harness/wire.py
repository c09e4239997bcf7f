"""Emulates a bad network between two machines: a namespace behind a user-space cable that loses and delays packets.

`python3 -m pioneer_harness.wire DESCRIPTOR` is the cable. It runs in the namespace, opens a TUN device there,
and forwards packets between it and the TUN device that it inherits. Kernels without netem can emulate no delay or
reordering otherwise.
"""

import dataclasses
import fcntl
import heapq
import itertools
import json
import os
import random
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

from pioneer_harness.error import HarnessError
from pioneer_harness.port import claimed

_NETWORK, _WIRES = "10.231.78", 32
"""Each wire uses eight addresses of the network."""

_SET_NAME, _TUN_WITHOUT_HEADER = 0x400454CA, 0x1001
_LARGEST = 65536
_QUEUE = 0.5
"""Packets that would wait longer for a limited rate are dropped [s]."""


class WireError(HarnessError):
    """This machine does not allow a namespace with TUN devices to be set up."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """The state of one direction of a wire."""

    loss: float = 0.0  #: share of packets lost
    delay: float = 0.0  #: of each packet [s]
    jitter: float = 0.0  #: maximum additional random delay, so that packets overtake each other [s]
    rate: float = 0.0  #: maximum rate [bit/s]; 0 for no limit
    mtu: int = 0  #: longer packets are lost without notice [bytes]; 0 for no limit
    cut: bool = False  #: whether all packets are lost


class Way:
    """One direction of a wire, with the packets in transit.

    Args:
        seed: of the losses and random delays.
    """

    def __init__(self, seed: int) -> None:
        self.condition = Condition()
        self._random = random.Random(seed)
        self._free = 0.0
        self._order = itertools.count()
        self._under_way: list[tuple[float, int, bytes]] = []

    @property
    def due(self) -> float | None:
        """Arrival time of the next packet [s]; None if there is none."""
        return self._under_way[0][0] if self._under_way else None

    def send(self, now: float, packet: bytes) -> None:
        """Sends a packet at time ``now`` [s]."""
        condition = self.condition
        is_too_long = 0 < condition.mtu < len(packet)
        if condition.cut or is_too_long or self._random.random() < condition.loss:
            return
        begins = max(self._free, now)
        if begins - now > _QUEUE:
            return
        if condition.rate:
            self._free = begins = begins + 8 * len(packet) / condition.rate
        due = begins + condition.delay + condition.jitter * self._random.random()
        heapq.heappush(self._under_way, (due, next(self._order), packet))

    def arrived(self, now: float) -> Iterator[bytes]:
        """Removes and yields the packets that have arrived by time ``now`` [s]."""
        while self._under_way and self._under_way[0][0] <= now:
            yield heapq.heappop(self._under_way)[2]


class WiredMachine:
    """A network namespace behind a wire, whose two directions have conditions.

    Raises:
        WireError: CAP_NET_ADMIN, CAP_SYS_ADMIN or /dev/net/tun is missing.
    """

    def __init__(self) -> None:
        number, self._reserved = _free_wire()
        #: there: address of the far end; here: our address
        self.here, self.there = (f"{_NETWORK}.{8 * number + end}" for end in (1, 2))
        self.elsewhere = f"{_NETWORK}.{8 * number + 3}"  #: another address for the far end
        self.name, self._near = f"pioneer-wire-{os.getpid()}-{number}", f"pioneerwire{number}"
        #: command prefix that runs a command there
        self.prefix = ("ip", "netns", "exec", self.name)
        self._process: subprocess.Popen[str] | None = None
        try:
            _run("ip", "netns", "add", self.name)
            device = _tun(self._near)
            _run("ip", "address", "add", f"{self.here}/29", "dev", self._near)
            _run("ip", "link", "set", self._near, "up")
            self._process = subprocess.Popen(
                [*self.prefix, sys.executable, "-m", "pioneer_harness.wire", str(device)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                pass_fds=[device],
            )
            os.close(device)
            assert self._process.stdout
            if self._process.stdout.readline() != "ready\n":
                raise WireError("the wire has not started")
            self.run("ip", "link", "set", "lo", "up")
            self.run("ip", "link", "set", "wire", "up")
            self.run("ip", "address", "add", f"{self.there}/29", "dev", "wire")
        except (OSError, WireError) as error:
            self.close()
            raise WireError(f"no wire between machines: {error}") from None

    def run(self, *argv: str) -> None:
        """Runs a command there and waits for it."""
        _run(*self.prefix, *argv)

    def set(self, out: Condition, back: Condition | None = None) -> None:
        """Sets the condition of the direction from there to here, and of the other one; None for the same."""
        assert self._process
        assert self._process.stdin
        conditions = [dataclasses.asdict(out), dataclasses.asdict(back or out)]
        self._process.stdin.write(json.dumps(conditions) + "\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """Removes the wire and the namespace; its processes must have ended."""
        if self._process is not None:
            self._process.communicate()
        subprocess.run(["ip", "netns", "delete", self.name], capture_output=True, check=False)
        self._reserved.close()


def _tun(name: str) -> int:
    """Returns the descriptor of a new TUN device in this process's network."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _SET_NAME, struct.pack("16sH22x", name.encode(), _TUN_WITHOUT_HEADER))
    return device


def _free_wire() -> tuple[int, socket.socket]:
    for number in range(_WIRES):
        if (name := claimed(f"pioneer-wire-{number}")) is not None:
            return number, name
    raise WireError(f"all {_WIRES} wires are taken")


def _run(*argv: str) -> None:
    try:
        done = subprocess.run(argv, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise WireError(f"{argv[0]} is not installed: apt install iproute2") from None
    if done.returncode:
        raise WireError(f"{' '.join(argv)}: {done.stderr.strip()}")


def _forward(near: int, far: int) -> None:
    """Forwards packets until standard input is closed; each line there has the conditions of both directions."""
    ways = {far: (near, Way(1)), near: (far, Way(2))}
    while True:
        times = [way.due for _, way in ways.values() if way.due is not None]
        pause = max(0.0, min(times) - time.monotonic()) if times else None
        ready, _, _ = select.select([0, near, far], [], [], pause)
        for device in ready:
            if device == 0:
                lines = os.read(0, _LARGEST).splitlines()
                if not lines:
                    return
                for way, condition in zip(
                    (ways[far][1], ways[near][1]), json.loads(lines[-1]), strict=True
                ):
                    way.condition = Condition(**condition)
                continue
            try:
                packet = os.read(device, _LARGEST)
            except OSError:
                continue  # the device has been taken down
            ways[device][1].send(time.monotonic(), packet)
        for out, way in ways.values():
            for packet in way.arrived(time.monotonic()):
                try:
                    os.write(out, packet)
                except OSError:
                    continue  # as above: lost


def main() -> None:
    """Runs the cable."""
    far = _tun("wire")
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    _forward(int(sys.argv[1]), far)


if __name__ == "__main__":
    main()
