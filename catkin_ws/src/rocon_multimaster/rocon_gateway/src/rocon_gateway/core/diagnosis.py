"""What may keep a gateway from working, told from measured facts, each finding with its fix."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rocon_gateway.core.examination import Contact, Examination
from rocon_gateway.core.matching import base_name
from rocon_gateway.core.table import table

CLOCK_TOLERANCE = 0.1
"""Clocks of two machines may differ by so much [s] before one finds the other's transforms too old or too new."""


class Level(enum.StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    level: Level  #: how it is
    what: str  #: what was found, one sentence
    fix: str = ""  #: what to do; empty if all is well


def of_contact(contact: Contact, fix: str, there: str = "here") -> Finding:
    """Returns whether a name resolves and its port answers; `fix` is for a port that does not.

    `there` says on which machine this was tried.
    """
    where = f"{contact.what} at {contact.host}:{contact.port}"
    if not contact.address:
        cure = f"put '{contact.host}' with its address into /etc/hosts {there}, or set ROS_IP where it runs"
        return Finding(Level.FAULT, f"{where}: the name does not resolve", cure)
    if contact.error:
        return Finding(Level.FAULT, f"{where}: {contact.error}", fix)
    return Finding(Level.OK, f"{where} answers")


def of_own_name(name: str, address: str, there: str = "here") -> Finding:
    """Returns whether the nodes of one machine find each other under the name that they are known by.

    Args:
        name: ROS_HOSTNAME, ROS_IP or the host's name.
        address: what it resolves to there; empty if it does not.
        there: which machine this is.
    """
    if not address:
        cure = f"put '127.0.1.1 {name}' into /etc/hosts {there}, or set ROS_IP to that machine's address"
        return Finding(Level.FAULT, f"the machine's name '{name}' does not resolve {there}", cure)
    return Finding(Level.OK, f"the machine's name '{name}' means {address} {there}")


def of_advertised_host(gateway: str, host: str, others: Sequence[str]) -> list[Finding]:
    """Returns a finding if other machines cannot dial a relay under the address that its gateway tells them.

    Args:
        gateway: its name.
        host: its record's host.
        others: the hosts in the others' records.
    """
    if not _is_loopback(host) or all(other == host or _is_loopback(other) for other in others):
        return []
    cure = "set GATEWAY_NETWORK_INTERFACE, or ROS_IP to its machine's address in the network, before it starts"
    return [Finding(Level.FAULT, f"gateway '{gateway}' tells others to dial {host}, which is their own machine", cure)]


def _is_loopback(host: str) -> bool:
    return host.startswith("127.") or host == "localhost"


def of_clock(offset: float, whose: str = "ours") -> Finding:
    """Returns whether a clock and the hub's agree; `offset` is how far the hub's is ahead [s]."""
    what = f"the hub's clock is {abs(offset):.3f} s {'ahead of' if offset >= 0 else 'behind'} {whose}"
    if abs(offset) <= CLOCK_TOLERANCE:
        return Finding(Level.OK, what)
    return Finding(Level.WARNING, what, "let chrony or ntpd set both clocks; with simulated time it does not matter")


def of_python(first: str, works: bool, expected: str, where: str = "") -> Finding:
    """Returns whether the first `python3` on the PATH can run ROS programs.

    Args:
        first: its path; empty if there is none.
        works: whether it imports rospy.
        expected: the interpreter that does.
        where: on which machine, " at gateway 'base'"; empty for this one.
    """
    if works:
        return Finding(Level.OK, f"the first python3 on the PATH{where}, {first}, imports rospy")
    found = f"the first python3 on the PATH{where}, {first}, cannot import rospy"
    folder = expected.rpartition("/")[0]
    cure = f"export PATH={folder}:$PATH{where} (programs of this workspace name their interpreter and do not need it)"
    return Finding(Level.WARNING, found if first else f"there is no python3 on the PATH{where}", cure)


def of_duplicates(names: Iterable[str]) -> list[Finding]:
    """Returns a finding for each base name that several gateways have: a rule for it means all of them."""
    seen: dict[str, int] = {}
    for name in names:
        seen[base_name(name)] = seen.get(base_name(name), 0) + 1
    cure = "give each its own gateway_name (export HOSTNAME before pioneer_gateway.launch)"
    return [
        Finding(Level.WARNING, f"{count} gateways are called '{name}'", cure)
        for name, count in seen.items()
        if count > 1
    ]


HERE = ""
"""The name, in place of a gateway's, of the machine on which the doctor runs, if that has no gateway."""

NO_ANSWER_FIX = (
    "look into its log and start it again: it hangs, is another program, or older than the doctor; "
    "one that was killed a moment ago is struck off the hub in 2 s"
)


def of_examinations(seen: Sequence[Examination], alive: Sequence[str]) -> list[Finding]:
    """Returns what every gateway sees, in short if all is well; who has not answered is a finding.

    Args:
        seen: the answers; `HERE` may be one of them.
        alive: unique names of all gateways that should have answered.
    """
    answered = {one.gateway for one in seen}
    found = [
        Finding(Level.FAULT, f"gateway '{name}' is on the hub, but does not answer the doctor", NO_ANSWER_FIX)
        for name in alive
        if name not in answered
    ]
    for one in seen:
        there = f"at gateway '{one.gateway}'" if one.gateway != HERE else "here"
        found.append(of_own_name(one.host_name, one.host_address, there))
        found.append(of_clock(one.clock, f"that {there}"))
        if one.gateway != HERE:  # where the doctor runs it has looked at the PATH already
            found.append(of_python(one.python, one.python_works, one.interpreter, f" {there}"))
        found += _of_links(one, there, alive)
    return found


def _of_links(one: Examination, there: str, alive: Sequence[str]) -> list[Finding]:
    others = [name for name in alive if name != one.gateway]
    tried = {contact.what: contact for contact in one.contacts}
    found = []
    for name in others:
        if name not in tried:
            cure = "run the doctor again; if that lasts, both are on the hub but do not hear the same: restart the hub"
            found.append(Finding(Level.WARNING, f"gateway '{name}' is not known {there}", cure))
            continue
        contact = tried[name]
        cure = (
            f"let TCP port {contact.port} through the firewall of {contact.host} (relay_port:=N fixes the number), and "
            f"out of the machine {there}; if that is not its address, set ROS_IP there"
        )
        named = Contact(f"gateway '{name}', seen {there},", contact.host, contact.port, contact.address, contact.error)
        finding = of_contact(named, cure, there)
        if finding.level != Level.OK:
            found.append(finding)
    return found or [Finding(Level.OK, f"{len(others)} relays answer {there}")]


def matrix(seen: Sequence[Examination], alive: Sequence[str]) -> str:
    """Returns a table of who reaches whose relay; columns have the numbers of the rows."""
    by_name = {one.gateway: one for one in seen}
    rows = [(str(number), name, *_cells(by_name.get(name), alive)) for number, name in enumerate(alive, 1)]
    if HERE in by_name:
        rows.append(("", "(here)", *_cells(by_name[HERE], alive)))
    return table(("", "FROM \\ TO", *(str(number + 1) for number in range(len(alive)))), rows)


def _cells(one: Examination | None, alive: Sequence[str]) -> list[str]:
    if one is None:
        return ["?" for _ in alive]
    tried = {contact.what: contact for contact in one.contacts}
    return ["-" if name == one.gateway else _cell(tried.get(name)) for name in alive]


def _cell(contact: Contact | None) -> str:
    if contact is None:
        return "?"
    return "no name" if not contact.address else "NO" if contact.error else "ok"


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
