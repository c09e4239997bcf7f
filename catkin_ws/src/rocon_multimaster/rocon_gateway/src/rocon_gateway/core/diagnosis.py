"""What may keep a gateway from working, told from measured facts, each finding with its fix."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rocon_gateway.core.rule import base_name

CLOCK_TOLERANCE = 0.1
"""Clocks of two machines may differ by so much [s] before one finds the other's transforms too old or too new."""


class Level(enum.StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        level: how it is.
        what: what was found, one sentence.
        fix: what to do; empty if all is well.
    """

    level: Level
    what: str
    fix: str = ""


@dataclass(frozen=True, slots=True)
class Contact:
    """An attempt to reach a TCP port.

    Attributes:
        what: whose port it is.
        host: the host as it was named.
        port: the port.
        address: what the name resolved to; empty if it did not.
        error: why the port was not reached; empty if it was.
    """

    what: str
    host: str
    port: int
    address: str = ""
    error: str = ""


def of_contact(contact: Contact, fix: str) -> Finding:
    """Returns whether a name resolves and its port answers; `fix` is for a port that does not."""
    where = f"{contact.what} at {contact.host}:{contact.port}"
    if not contact.address:
        cure = f"put '{contact.host}' with its address into /etc/hosts here, or set ROS_IP where it runs"
        return Finding(Level.FAULT, f"{where}: the name does not resolve", cure)
    if contact.error:
        return Finding(Level.FAULT, f"{where}: {contact.error}", fix)
    return Finding(Level.OK, f"{where} answers")


def of_own_name(name: str, address: str, far: bool) -> Finding:
    """Returns whether others can use the name under which this machine's nodes are known.

    Args:
        name: ROS_HOSTNAME, ROS_IP or the host's name.
        address: what it resolves to here; empty if it does not.
        far: whether gateways of other machines are on the hub.
    """
    if not address:
        cure = f"put '127.0.1.1 {name}' into /etc/hosts, or set ROS_IP to this machine's address"
        return Finding(Level.FAULT, f"this machine's name '{name}' does not resolve here", cure)
    if far and address.startswith("127."):
        cure = "only this machine's nodes need it; set ROS_IP if other machines shall run nodes of this master"
        return Finding(Level.OK, f"this machine's name '{name}' means {address}; {cure}")
    return Finding(Level.OK, f"this machine's name '{name}' means {address}")


def of_advertised_host(host: str, remotes: Sequence[str]) -> Finding:
    """Returns whether other machines can dial the relay under the address that we tell them.

    Args:
        host: our record's host.
        remotes: the hosts in the others' records.
    """
    loopback = host.startswith("127.") or host == "localhost"
    if loopback and any(other != host and not other.startswith("127.") for other in remotes):
        cure = "set ROS_IP to this machine's address in the network before the gateway starts"
        return Finding(Level.FAULT, f"our gateway tells others to dial {host}, which is their own machine", cure)
    return Finding(Level.OK, f"our gateway tells others to dial {host}")


def of_clock(offset: float) -> Finding:
    """Returns whether our clock and the hub's agree; `offset` is how far the hub's is ahead [s]."""
    what = f"the hub's clock is {abs(offset):.3f} s {'ahead of' if offset >= 0 else 'behind'} ours"
    if abs(offset) <= CLOCK_TOLERANCE:
        return Finding(Level.OK, what)
    return Finding(Level.WARNING, what, "let chrony or ntpd set both clocks; with simulated time it does not matter")


def of_python(first: str, works: bool, expected: str) -> Finding:
    """Returns whether the first `python3` on the PATH can run ROS programs.

    Args:
        first: its path; empty if there is none.
        works: whether it imports rospy.
        expected: the interpreter that does.
    """
    if works:
        return Finding(Level.OK, f"the first python3 on the PATH, {first}, imports rospy")
    what = (
        f"the first python3 on the PATH, {first}, cannot import rospy" if first else "there is no python3 on the PATH"
    )
    folder = expected.rpartition("/")[0]
    cure = f"export PATH={folder}:$PATH (programs of this workspace name their interpreter and do not need it)"
    return Finding(Level.WARNING, what, cure)


def of_duplicates(names: Iterable[str]) -> list[Finding]:
    """Returns a finding for each base name that several gateways bear: a rule for it means all of them."""
    seen: dict[str, int] = {}
    for name in names:
        seen[base_name(name)] = seen.get(base_name(name), 0) + 1
    cure = "give each its own gateway_name (export HOSTNAME before pioneer_gateway.launch)"
    return [
        Finding(Level.WARNING, f"{count} gateways are called '{name}'", cure)
        for name, count in seen.items()
        if count > 1
    ]


def report(findings: Iterable[Finding]) -> str:
    """Returns all findings, faults with their fixes below, and a closing line."""
    findings = list(findings)
    lines = []
    for finding in findings:
        lines.append(f"{finding.level:<8} {finding.what}")
        if finding.fix:
            lines.append(f"{'':<8} → {finding.fix}")
    bad = sum(finding.level != Level.OK for finding in findings)
    lines.append(f"{len(findings)} things looked at, " + (f"{bad} to mend" if bad else "all well"))
    return "\n".join(lines)


def status(findings: Iterable[Finding]) -> int:
    """Returns the exit status: 1 if something is at fault; warnings are none."""
    return int(any(finding.level == Level.FAULT for finding in findings))
