"""The command `doctor`: what keeps gateways from working, seen from each of them, and what to do about it."""

import argparse
import dataclasses
import json
import sys
import urllib.parse
from collections.abc import Iterator

import redis
import rosgraph
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gateway_msgs.msg import GatewayInfo

from rocon_gateway.commands.client import GatewayClient, NoGatewayError
from rocon_gateway.doctor import diagnosis, facts
from rocon_gateway.doctor.diagnosis import Finding, Level
from rocon_gateway.hub.session import HubSession
from rocon_gateway.rules import verdict
from rocon_gateway.rules.situation import WORKING, State
from rocon_hub_protocol.address import address_from_uri
from rocon_hub_protocol.code import HubProtocolError
from rocon_hub_protocol.password import password_from
from rocon_hub_protocol.redis_client import Access
from tcpros.client import Client
from tcpros.error import CertificateError, TcprosError
from tcpros.tls import certificates_from

HUB_FIX = (
    "start it (rosrun pioneer_networking run-pioneer-hub); let its port through the firewall there"
)
DOOR_TOPIC = "/ros2_door/topics"
NO_HUB_FIX = (
    "start one (run-pioneer-hub); on another machine it needs a password or hub_insecure:=true to be seen; "
    "where the network carries no mDNS, give gateway_hub_uri:=http://HOST:6380"
)


def main() -> int:
    """Entry point of `doctor`; the exit status is 0 if there are no faults, else 1."""
    parser = argparse.ArgumentParser("doctor", description=__doc__)
    parser.add_argument(
        "--hub", default="", help="the hub, host:port; else the gateway's, else those announced"
    )
    parser.add_argument("--json", action="store_true", help="for programs: the findings")
    options = parser.parse_args([one for one in sys.argv[1:] if ":=" not in one])
    found = list(_examine(options.hub))
    findings = [one for one in found if isinstance(one, Finding)]
    tables = [one for one in found if isinstance(one, str)]
    if options.json:
        plain = [{**dataclasses.asdict(one), "level": one.level.name.lower()} for one in findings]
        sys.stdout.write(json.dumps({"findings": plain}, indent=2, ensure_ascii=False) + "\n")
        return diagnosis.status(findings)
    sys.stdout.write("\n\n".join([*tables, diagnosis.report(findings)]) + "\n")
    return diagnosis.status(findings)


def _examine(hub: str) -> Iterator[Finding | str]:
    """Yields findings, and tables to print before them."""
    yield diagnosis.of_python(*facts.first_python())
    master = urllib.parse.urlsplit(rosgraph.get_master_uri())
    (contact,) = facts.contacts(
        [("the ROS master", master.hostname or "localhost", master.port or 11311)]
    )
    yield diagnosis.of_contact(contact, "start it, or set ROS_MASTER_URI to the one you mean")
    client = info = None
    try:
        client = GatewayClient()
        info = client.latched("gateway_info", GatewayInfo)
        yield Finding(Level.OK, f"gateway '{info.name}' runs as {client.namespace}")
    except NoGatewayError as error:
        yield Finding(
            Level.FAULT, str(error), "roslaunch pioneer_networking pioneer_gateway.launch"
        )
    yield from _hub(hub, info)
    if client is not None:
        yield from _rules(client)
    if not contact.error:
        yield from _doors()


def _hub(named: str, info: GatewayInfo | None) -> Iterator[Finding | str]:
    """Examines each hub and all gateways on it."""
    uris = [named] if named else [*info.hub_uris, *info.discover_hubs_by_uri] if info else []
    if info is not None and not info.connected:
        yield Finding(
            Level.FAULT,
            "the gateway is not on a hub",
            "see the hub's line below, and the gateway's log",
        )
    if not uris:
        seen = facts.announced_hubs()
        for sighting in seen:
            yield Finding(
                Level.OK, f"'{sighting.name}' is announced at {', '.join(map(str, sighting.hubs))}"
            )
        if not seen:
            yield Finding(Level.FAULT, "no hub is named and none announces itself", NO_HUB_FIX)
        return
    for uri in dict.fromkeys(uris):
        yield from _one_hub(uri, info)


def _one_hub(uri: str, info: GatewayInfo | None) -> Iterator[Finding | str]:
    try:
        address = address_from_uri(uri)
        (contact,) = facts.contacts([("the hub", address.host, address.port)])
        yield diagnosis.of_contact(contact, HUB_FIX)
        if not contact.error and contact.address:
            access = Access(password_from(""), certificates_from(""))
            session = HubSession(address, access, "doctor", "")
            try:
                yield from _members(session, info)
            finally:
                session.close()
    except (HubProtocolError, CertificateError, redis.RedisError) as error:
        yield Finding(
            Level.FAULT, str(error), "give the doctor and the gateway what the hub asks for"
        )


def _members(session: HubSession, info: GatewayInfo | None) -> Iterator[Finding | str]:
    """Makes every gateway on the hub examine its links; examines from here too if no gateway runs here."""
    yield Finding(Level.OK, f"the hub is '{session.hub_name}'")
    described = session.describe(())
    yield from diagnosis.of_duplicates(one.record.name for one in described)
    for one in described:
        if one.silence:
            cure = "start it again, or wait: the hub forgets it soon"
            yield Finding(
                Level.WARNING,
                f"gateway '{one.record.name}' was last heard of {one.silence:.0f} s ago",
                cure,
            )
    alive = [one.record for one in described if not one.silence]
    for record in alive:
        hosts = [other.host for other in alive if other is not record]
        yield from diagnosis.of_advertised_host(record.name, record.host, hosts)
    names = sorted(record.name for record in alive)
    seen = facts.ask(session, names)
    if info is None:
        seen.append(facts.examination(session, diagnosis.HERE))
    if names:
        yield diagnosis.matrix(seen, names)
    yield from diagnosis.of_examinations(seen, names)


def _rules(client: GatewayClient) -> Iterator[Finding]:
    try:
        states = client.latched("rules", DiagnosticArray).status
    except NoGatewayError as error:
        yield Finding(Level.FAULT, str(error), "look into the gateway's log")
        return
    values = [{one.key: one.value for one in state.values} for state in states]
    idle = sum(one["state"] not in WORKING for one in values)
    what = f"{len(states) - idle} of {len(states)} rules are active"
    yield (
        Finding(Level.WARNING, what, "rosrun rocon_gateway rules says why")
        if idle
        else Finding(Level.OK, what)
    )
    yield from diagnosis.of_paths(
        (one["gateway"], one["reason"]) for one in values if one["state"] == State.MTU
    )
    for state in states:
        before, mark, cure = state.message.partition(verdict.UNCOVERED)
        if mark:
            yield Finding(
                Level.WARNING, f"{state.name}: {before}not covered by a rule", cure.strip(" '")
            )


def _doors() -> Iterator[Finding]:
    """Yields what each door to ROS 2 on this master reports."""
    client = Client(rosgraph.get_master_uri(), "/doctor")
    try:
        publishers, _, _ = client.ask_master("getSystemState")
    except (OSError, TcprosError) as error:
        yield Finding(Level.FAULT, f"the ROS master does not answer: {error}", "start it again")
        return
    doors = [(topic, node) for topic, nodes in publishers for node in nodes]
    for topic, node in doors:
        if not topic.endswith(DOOR_TOPIC):
            continue
        try:
            states = client.latched(node, topic, DiagnosticArray).status
        except (OSError, TcprosError) as error:
            what = f"the door to ROS 2, {node}, does not answer: {error}"
            yield Finding(Level.FAULT, what, "look into its log, or start it again")
            continue
        rows = [(one.name, one.message, one.level == DiagnosticStatus.OK) for one in states]
        yield from diagnosis.of_door(node, rows)
