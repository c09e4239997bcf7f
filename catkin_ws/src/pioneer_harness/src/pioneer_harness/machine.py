"""Emulates a second machine: a network namespace on a virtual cable that can be cut, rate-limited or made lossy."""

import os
import socket
import subprocess

from pioneer_harness.error import HarnessError
from pioneer_harness.port import claimed

_NETWORK, _CABLES = "10.231.77", 64
"""Each cable uses four addresses of the network."""


class MachineError(HarnessError):
    """This machine does not allow a network namespace to be set up."""


class FarMachine:
    """A network namespace, connected to ours by a veth pair.

    Raises:
        MachineError: CAP_NET_ADMIN or CAP_SYS_ADMIN is missing (needs root, and no unprivileged container).
    """

    def __init__(self) -> None:
        number, self._reserved = _free_cable()
        #: there: address of the far end
        #: here: our address on the cable, unique among our emulated machines
        self.here, self.there = (f"{_NETWORK}.{4 * number + end}" for end in (1, 2))
        self.name, self._near = f"pioneer-{os.getpid()}-{number}", f"pioneer{number}"
        self.prefix = (
            "ip",
            "netns",
            "exec",
            self.name,
        )  #: command prefix that runs a command there
        self._swallowed = 0
        try:
            _run("ip", "netns", "add", self.name)
            _run(
                "ip",
                "link",
                "add",
                self._near,
                "type",
                "veth",
                "peer",
                "name",
                "eth0",
                "netns",
                self.name,
            )
            _run("ip", "address", "add", f"{self.here}/30", "dev", self._near)
            _run("ip", "link", "set", self._near, "up")
            self.run("ip", "address", "add", f"{self.there}/30", "dev", "eth0")
            self.plug()
            self.run("ip", "link", "set", "lo", "up")
        except MachineError:
            self.close()
            raise

    def run(self, *argv: str) -> None:
        """Runs a command there and waits for it."""
        _run(*self.prefix, *argv)

    def unplug(self) -> None:
        """Unplugs the cable at the far end: packets no longer arrive in either direction."""
        self.run("ip", "link", "set", "eth0", "down")

    def plug(self) -> None:
        """Plugs the cable in again."""
        self.run("ip", "link", "set", "eth0", "up")

    def narrow(self, rate: str) -> None:
        """Limits the traffic from there to `rate`, in tc's notation."""
        self.run(
            "tc",
            "qdisc",
            "replace",
            "dev",
            "eth0",
            "root",
            "tbf",
            "rate",
            rate,
            "burst",
            "16kb",
            "latency",
            "400ms",
        )

    def widen(self) -> None:
        """Removes the rate limit."""
        self.run("tc", "qdisc", "delete", "dev", "eth0", "root")

    def lose(self, share: float) -> None:
        """Drops a random ``share`` of all packets that arrive there."""
        match = ("-m", "statistic", "--mode", "random", "--probability", str(share))
        self.run("iptables", "-A", "INPUT", "-i", "eth0", *match, "-j", "DROP")

    def swallow(self, size: int) -> None:
        """Drops all packets longer than ``size`` [bytes] in both directions, as a tunnel with a small MTU may do."""
        # The kernel would hand over several segments as one long packet.
        _run("ip", "link", "set", self._near, "gso_max_segs", "1")
        self.run("ip", "link", "set", "eth0", "gso_max_segs", "1")
        _run("iptables", "-A", *self._longer(self._near, size))
        self._swallowed = size
        self.run("iptables", "-A", *self._longer("eth0", size))

    def pass_all(self) -> None:
        """Ends `swallow`."""
        if self._swallowed:
            _run("iptables", "-D", *self._longer(self._near, self._swallowed))
            self.run("iptables", "-D", *self._longer("eth0", self._swallowed))
            self._swallowed = 0

    def _longer(self, device: str, size: int) -> tuple[str, ...]:
        match = ("-m", "length", "--length", f"{size + 1}:")
        return ("INPUT", "-i", device, *match, "-j", "DROP")

    def close(self) -> None:
        """Removes the namespace and the cable; its processes must have ended."""
        if self._swallowed:
            rule = self._longer(self._near, self._swallowed)
            subprocess.run(["iptables", "-D", *rule], capture_output=True, check=False)
        subprocess.run(["ip", "link", "delete", self._near], capture_output=True, check=False)
        subprocess.run(["ip", "netns", "delete", self.name], capture_output=True, check=False)
        self._reserved.close()


def _free_cable() -> tuple[int, socket.socket]:
    """Returns a free cable number, and the socket that reserves it until closed.

    As in `PortReservation`, the reservation is an abstract socket name that lives as long as its socket.
    """
    for number in range(_CABLES):
        if (name := claimed(f"pioneer-cable-{number}")) is not None:
            return number, name
    raise MachineError(f"all {_CABLES} addresses for other machines are taken")


def _run(*argv: str) -> None:
    try:
        done = subprocess.run(argv, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MachineError(f"{argv[0]} is not installed: apt install iproute2 iptables") from None
    if done.returncode:
        raise MachineError(f"{' '.join(argv)}: {done.stderr.strip()}")
