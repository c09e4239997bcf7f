"""The command `doctor`: what keeps this machine's gateway from working, and what to do about it."""

import argparse
import socket
import sys
import urllib.parse
from collections.abc import Iterator

import redis
import rosgraph
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gateway_msgs.msg import GatewayInfo

from rocon_gateway.adapters import examination
from rocon_gateway.adapters.client import ClientError, GatewayClient
from rocon_gateway.adapters.hub_session import Description, HubSession
from rocon_gateway.adapters.password import password_from
from rocon_gateway.core import diagnosis
from rocon_gateway.core.code import GatewayError
from rocon_gateway.core.diagnosis import Finding, Level
from rocon_gateway.core.hub import address_from_uri

HUB_FIX = "start it (rosrun pioneer_networking run-pioneer-hub); let its port through the firewall there"
NO_HUB_FIX = (
    "start one (run-pioneer-hub); on another machine it needs a password or hub_insecure:=true to be seen; "
    "where the network carries no mDNS, give gateway_hub_uri:=http://HOST:6380"
)


def main() -> int:
    """Entry point of `doctor`; the exit status is 0 if nothing is at fault, else 1."""
    parser = argparse.ArgumentParser("doctor", description=__doc__)
    parser.add_argument("--hub", default="", help="the hub, host:port; else the gateway's, else those announced")
    options = parser.parse_args([one for one in sys.argv[1:] if ":=" not in one])
    findings = list(_examine(options.hub))
    sys.stdout.write(diagnosis.report(findings) + "\n")
    return diagnosis.status(findings)


def _examine(hub: str) -> Iterator[Finding]:
    yield diagnosis.of_python(*examination.first_python())
    master = urllib.parse.urlsplit(rosgraph.get_master_uri())
    (contact,) = examination.contacts([("the ROS master", master.hostname or "localhost", master.port or 11311)])
    yield diagnosis.of_contact(contact, "start it, or set ROS_MASTER_URI to the one you mean")
    client = info = None
    try:
        client = GatewayClient()
        info = client.latched("gateway_info", GatewayInfo)
        yield Finding(Level.OK, f"gateway '{info.name}' runs as {client.namespace}")
    except ClientError as error:
        yield Finding(Level.FAULT, str(error), "roslaunch pioneer_networking pioneer_gateway.launch")
    yield from _hub(hub, info)
    if client is not None:
        yield _rules(client)


def _hub(named: str, info: GatewayInfo | None) -> Iterator[Finding]:
    """Looks at each hub and at all gateways on it."""
    uris = [named] if named else [*info.hub_uris, *info.discover_hubs_by_uri] if info else []
    if info is not None and not info.connected:
        yield Finding(Level.FAULT, "the gateway is not on a hub", "see the hub's line below, and the gateway's log")
    if not uris:
        seen = examination.announced_hubs()
        for sighting in seen:
            yield Finding(Level.OK, f"'{sighting.name}' is announced at {', '.join(map(str, sighting.hubs))}")
        if not seen:
            yield Finding(Level.FAULT, "no hub is named and none announces itself", NO_HUB_FIX)
        return
    for uri in dict.fromkeys(uris):
        yield from _one_hub(uri, info)


def _one_hub(uri: str, info: GatewayInfo | None) -> Iterator[Finding]:
    try:
        address = address_from_uri(uri)
        (contact,) = examination.contacts([("the hub", address.host, address.port)])
        yield diagnosis.of_contact(contact, HUB_FIX)
        if not contact.error and contact.address:
            session = HubSession(address, password_from(""), "doctor", "")
            try:
                yield from _members(session, info)
            finally:
                session.close()
    except (GatewayError, redis.RedisError) as error:
        yield Finding(Level.FAULT, str(error), "give the doctor and the gateway what the hub asks for")


def _members(session: HubSession, info: GatewayInfo | None) -> Iterator[Finding]:
    yield Finding(Level.OK, f"the hub is '{session.hub_name}'")
    yield diagnosis.of_clock(examination.clock_offset(session))
    described = session.describe(())
    own = info.name if info else ""
    others = [one for one in described if one.record.name != own]
    hosts = [one.record.host for one in others]
    name = rosgraph.network.get_host_name()
    name = name if name != "localhost" else socket.gethostname()
    yield diagnosis.of_own_name(name, examination.address_of(name), any(host not in _own() for host in hosts))
    yield from diagnosis.of_duplicates(one.record.name for one in described)
    for one in described:
        if one.record.name == own:
            yield diagnosis.of_advertised_host(one.record.host, hosts)
    yield from _relays(described)


def _own() -> set[str]:
    return {"localhost", *examination.own_addresses()}


def _relays(described: list[Description]) -> Iterator[Finding]:
    for one in described:
        if one.silence:
            cure = "start it again, or wait: the hub forgets it soon"
            yield Finding(Level.WARNING, f"gateway '{one.record.name}' was last heard of {one.silence:.0f} s ago", cure)
    alive = [one.record for one in described if not one.silence]
    for contact in examination.contacts((f"gateway '{one.name}'", one.host, one.port) for one in alive):
        cure = (
            f"let TCP port {contact.port} through the firewall of {contact.host} (relay_port:=N fixes the number); "
            "if that is not its address, set ROS_IP there"
        )
        yield diagnosis.of_contact(contact, cure)


def _rules(client: GatewayClient) -> Finding:
    try:
        states = client.latched("rules", DiagnosticArray).status
    except ClientError as error:
        return Finding(Level.FAULT, str(error), "look into the gateway's log")
    idle = sum(state.level != DiagnosticStatus.OK for state in states)
    what = f"{len(states) - idle} of {len(states)} rules are active"
    return Finding(Level.WARNING, what, "rosrun rocon_gateway rules says why") if idle else Finding(Level.OK, what)
