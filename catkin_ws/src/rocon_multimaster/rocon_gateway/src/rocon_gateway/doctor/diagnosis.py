"""Derives findings from measured facts: what may keep a gateway from working, each with a fix."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rocon_gateway.commands.table import table
from rocon_gateway.doctor.examination import Contact, Examination
from rocon_gateway.rules.matching import base_name

CLOCK_TOLERANCE = 0.1
"""Maximum clock offset of two machines [s]; beyond it, one rejects the other's transforms as too old or too new."""


class Level(enum.StrEnum):
    """Severity of a finding."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check."""

    level: Level  #: its severity
    what: str  #: the result, one sentence
    fix: str = ""  #: what to do; empty if the check passed


def of_door(node: str, states: Sequence[tuple[str, str, bool]]) -> list[Finding]:
    """Reports a door to ROS 2.

    Args:
        node: its node.
        states: name, text and whether it is in order, of the door itself and of each topic.
    """
    faults = [(name, text) for name, text, is_ok in states if not is_ok]
    what = f"the door to ROS 2, {node}: {len(states) - len(faults)} of {len(states)} states are in order"
    found = [Finding(Level.OK, what)]
    for name, text in faults:
        cure = "pioneer_ros2's README lists the states"
        found.append(Finding(Level.WARNING, f"{name}: {text}", cure))
    return found


def of_contact(contact: Contact, fix: str, there: str = "here") -> Finding:
    """Checks that a host name resolves and its port answers.

    `fix` applies to a port that does not answer; `there` names the machine that tried.
    """
    where = f"{contact.what} at {contact.host}:{contact.port}"
    if not contact.address:
        cure = f"put '{contact.host}' with its address into /etc/hosts {there}, or set ROS_IP where it runs"
        return Finding(Level.FAULT, f"{where}: the name does not resolve", cure)
    if contact.error:
        return Finding(Level.FAULT, f"{where}: {contact.error}", fix)
    return Finding(Level.OK, f"{where} answers")


def of_own_name(name: str, address: str, there: str = "here") -> Finding:
    """Checks that the nodes of one machine can reach each other under their advertised host name.

    Args:
        name: ROS_HOSTNAME, ROS_IP or the host's name.
        address: the address it resolves to there; empty if it does not resolve.
        there: names the machine.
    """
    if not address:
        cure = f"put '127.0.1.1 {name}' into /etc/hosts {there}, or set ROS_IP to that machine's address"
        return Finding(Level.FAULT, f"the machine's name '{name}' does not resolve {there}", cure)
    return Finding(Level.OK, f"the machine's name '{name}' means {address} {there}")


def of_advertised_host(gateway: str, host: str, others: Sequence[str]) -> list[Finding]:
    """Returns a finding if other machines cannot reach a relay under the address that its gateway advertises.

    Args:
        gateway: the gateway's name.
        host: the host in its record.
        others: the hosts in the other gateways' records.
    """
    if not _is_loopback(host) or all(other == host or _is_loopback(other) for other in others):
        return []
    cure = "set GATEWAY_NETWORK_INTERFACE, or ROS_IP to its machine's address in the network, before it starts"
    return [
        Finding(
            Level.FAULT,
            f"gateway '{gateway}' tells others to dial {host}, which is their own machine",
            cure,
        )
    ]


def _is_loopback(host: str) -> bool:
    return host.startswith("127.") or host in ("localhost", "::1")


def of_clock(offset: float, whose: str = "ours") -> Finding:
    """Checks that a clock agrees with the hub's; `offset` is how far the hub's clock is ahead [s]."""
    what = (
        f"the hub's clock is {abs(offset):.3f} s {'ahead of' if offset >= 0 else 'behind'} {whose}"
    )
    if abs(offset) <= CLOCK_TOLERANCE:
        return Finding(Level.OK, what)
    return Finding(
        Level.WARNING,
        what,
        "let chrony or ntpd set both clocks; with simulated time it does not matter",
    )


def of_python(first: str, works: bool, expected: str, where: str = "") -> Finding:
    """Checks that the first `python3` on the PATH can run ROS programs.

    Args:
        first: its path; empty if there is none.
        works: whether it can import rospy.
        expected: the interpreter that can.
        where: the machine, such as " at gateway 'base'"; empty for this one.
    """
    if works:
        return Finding(Level.OK, f"the first python3 on the PATH{where}, {first}, imports rospy")
    found = f"the first python3 on the PATH{where}, {first}, cannot import rospy"
    folder = expected.rpartition("/")[0]
    cure = f"export PATH={folder}:$PATH{where} (programs of this workspace name their interpreter and do not need it)"
    return Finding(
        Level.WARNING, found if first else f"there is no python3 on the PATH{where}", cure
    )


def of_duplicates(names: Iterable[str]) -> list[Finding]:
    """Returns a finding for each base name shared by several gateways: a rule for it matches all of them."""
    seen: dict[str, int] = {}
    for name in names:
        seen[base_name(name)] = seen.get(base_name(name), 0) + 1
    cure = "give each its own gateway_name (export HOSTNAME before pioneer_gateway.launch)"
    return [
        Finding(Level.WARNING, f"{count} gateways are called '{name}'", cure)
        for name, count in seen.items()
        if count > 1
    ]


def of_paths(rules: Iterable[tuple[str, str]]) -> list[Finding]:
    """Returns a finding for each path that swallows full packets.

    Args:
        rules: gateway and reason of each rule in the state `mtu`.
    """
    cure = "set that MTU on the devices at both ends of the path, a VPN's first; messages cross meanwhile"
    return [
        Finding(Level.WARNING, f"the path to gateway '{gateway}': {reason}", cure)
        for gateway, reason in dict(rules).items()
    ]


HERE = ""
"""Stands for the doctor's own machine in place of a gateway's name, if no gateway runs there."""

NO_ANSWER_FIX = (
    "check its log and restart it: it hangs, is another program, or is too old for the doctor; "
    "a gateway that was just killed disappears from the hub after 2 s"
)


def of_examinations(seen: Sequence[Examination], alive: Sequence[str]) -> list[Finding]:
    """Returns findings from the answers of all gateways, and one for each gateway that has not answered.

    Args:
        seen: the answers; one may be from `HERE`.
        alive: unique names of all gateways that should have answered.
    """
    answered = {one.gateway for one in seen}
    found = [
        Finding(
            Level.FAULT,
            f"gateway '{name}' is on the hub, but does not answer the doctor",
            NO_ANSWER_FIX,
        )
        for name in alive
        if name not in answered
    ]
    for one in seen:
        there = f"at gateway '{one.gateway}'" if one.gateway != HERE else "here"
        found.append(of_own_name(one.host_name, one.host_address, there))
        found.append(of_clock(one.clock, f"that {there}"))
        if one.gateway != HERE:  # the doctor has already checked the PATH on its own machine
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
        named = Contact(
            f"gateway '{name}', seen {there},",
            contact.host,
            contact.port,
            contact.address,
            contact.error,
        )
        finding = of_contact(named, cure, there)
        if finding.level != Level.OK:
            found.append(finding)
    return found or [Finding(Level.OK, f"{len(others)} relays answer {there}")]


def matrix(seen: Sequence[Examination], alive: Sequence[str]) -> str:
    """Returns a table of which gateway reaches which relay; columns use the row numbers."""
    by_name = {one.gateway: one for one in seen}
    rows = [
        (str(number), name, *_cells(by_name.get(name), alive))
        for number, name in enumerate(alive, 1)
    ]
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
    """Returns all findings as text, each with its fix below, and a summary line."""
    findings = list(findings)
    lines = []
    for finding in findings:
        lines.append(f"{finding.level:<8} {finding.what}")
        if finding.fix:
            lines.append(f"{'':<8} → {finding.fix}")
    bad = sum(finding.level != Level.OK for finding in findings)
    lines.append(f"{len(findings)} checks, " + (f"{bad} to fix" if bad else "no problems"))
    return "\n".join(lines)


def status(findings: Iterable[Finding]) -> int:
    """Returns the exit status: 1 if there is a fault; warnings do not count."""
    return int(any(finding.level == Level.FAULT for finding in findings))
