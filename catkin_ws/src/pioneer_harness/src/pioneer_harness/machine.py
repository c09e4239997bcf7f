"""Another machine: a network namespace at the other end of a cable that can be cut, narrowed and made to lose."""

import os
import subprocess

from pioneer_harness.error import HarnessError

HERE, THERE = "10.231.77.1", "10.231.77.2"


class MachineError(HarnessError):
    """This machine will not let us make another one."""


class FarMachine:
    """A network namespace, joined to ours by a pair of virtual Ethernet devices.

    Attributes:
        prefix: a command that runs another one there.

    Raises:
        MachineError: that needs CAP_NET_ADMIN and CAP_SYS_ADMIN (root, and no unprivileged container).
    """

    def __init__(self) -> None:
        self.name = f"pioneer-{os.getpid()}"
        self._near = f"pnr{os.getpid() % 10**8}"
        self.prefix = ("ip", "netns", "exec", self.name)
        _run("ip", "netns", "add", self.name)
        try:
            _run("ip", "link", "add", self._near, "type", "veth", "peer", "name", "eth0", "netns", self.name)
            _run("ip", "address", "add", f"{HERE}/30", "dev", self._near)
            _run("ip", "link", "set", self._near, "up")
            self.run("ip", "address", "add", f"{THERE}/30", "dev", "eth0")
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


def _run(*argv: str) -> None:
    try:
        done = subprocess.run(argv, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MachineError(f"{argv[0]} is not installed: apt install iproute2 iptables") from None
    if done.returncode:
        raise MachineError(f"{' '.join(argv)}: {done.stderr.strip()}")
