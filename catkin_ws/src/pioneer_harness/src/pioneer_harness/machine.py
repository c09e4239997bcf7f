"""Another machine: a network namespace at the other end of a cable that can be cut, narrowed and made to lose."""

import os
import socket
import subprocess

from pioneer_harness.error import HarnessError

_NETWORK, _CABLES = "10.231.77", 64
"""Each cable takes four of the network's addresses."""


class MachineError(HarnessError):
    """This machine will not let us make another one."""


class FarMachine:
    """A network namespace, joined to ours by a pair of virtual Ethernet devices.

    Raises:
        MachineError: that needs CAP_NET_ADMIN and CAP_SYS_ADMIN (root, and no unprivileged container).
    """

    def __init__(self) -> None:
        number, self._reserved = _free_cable()
        #: there: that of the other end
        #: here: our address on the cable, which no other machine of ours has
        self.here, self.there = (f"{_NETWORK}.{4 * number + end}" for end in (1, 2))
        self.name, self._near = f"pioneer-{os.getpid()}-{number}", f"pioneer{number}"
        self.prefix = ("ip", "netns", "exec", self.name)  #: a command that runs another one there
        try:
            _run("ip", "netns", "add", self.name)
            _run("ip", "link", "add", self._near, "type", "veth", "peer", "name", "eth0", "netns", self.name)
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
        """Cuts the cable at the far end: no packet arrives any more, neither here nor there."""
        self.run("ip", "link", "set", "eth0", "down")

    def plug(self) -> None:
        """Mends the cable."""
        self.run("ip", "link", "set", "eth0", "up")

    def narrow(self, rate: str) -> None:
        """Lets no more than `rate` (as tc writes it) come from there."""
        self.run(
            "tc", "qdisc", "replace", "dev", "eth0", "root", "tbf", "rate", rate, "burst", "16kb", "latency", "400ms"
        )

    def widen(self) -> None:
        """Takes `narrow` back."""
        self.run("tc", "qdisc", "delete", "dev", "eth0", "root")

    def lose(self, share: float) -> None:
        """Drops this share of all packets that arrive there."""
        match = ("-m", "statistic", "--mode", "random", "--probability", str(share))
        self.run("iptables", "-A", "INPUT", "-i", "eth0", *match, "-j", "DROP")

    def close(self) -> None:
        """Takes all of it away; its processes must have ended."""
        subprocess.run(["ip", "link", "delete", self._near], capture_output=True, check=False)
        subprocess.run(["ip", "netns", "delete", self.name], capture_output=True, check=False)
        self._reserved.close()


def _free_cable() -> tuple[int, socket.socket]:
    """Returns a cable number that is free on this machine, and the socket that reserves it until it is closed.

    As with `PortReservation`, that is a name that lives as long as its socket.
    """
    for number in range(_CABLES):
        name = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            name.bind(f"\0pioneer-cable-{number}")
        except OSError:
            name.close()
        else:
            return number, name
    raise MachineError(f"all {_CABLES} addresses for other machines are taken")


def _run(*argv: str) -> None:
    try:
        done = subprocess.run(argv, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MachineError(f"{argv[0]} is not installed: apt install iproute2 iptables") from None
    if done.returncode:
        raise MachineError(f"{' '.join(argv)}: {done.stderr.strip()}")
