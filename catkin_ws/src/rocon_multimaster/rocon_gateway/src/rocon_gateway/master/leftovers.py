"""Removes what a killed gateway of our name left on our master: proxies that nobody serves any more."""

import time
from collections.abc import Iterator

from rocon_gateway.master.line import MasterError
from rocon_gateway.master.liveness import MasterCaller, name_of, refuses
from rocon_gateway.master.watch import system_rows
from rocon_gateway.rules.matching import base_name
from rocon_hub_protocol.rule import Kind
from rocon_relay.connection import gateway_in_proxy_uri, proxy_uri

PATIENCE = 5.0
"""Time after which no further proxy is examined [s]: hosts that do not answer must not delay the gateway's start."""
_UNREGISTER = {Kind.PUBLISHER: "unregisterPublisher", Kind.SUBSCRIBER: "unregisterSubscriber"}


def remove_leftovers(master_uri: str, node: str, gateway: str) -> list[str]:
    """Unregisters the dead proxies of earlier gateways of our name; returns their node names, sorted.

    Call it before this gateway registers proxies of its own. A proxy is dead if its port refuses connections, or if
    a Python node of another name has the port now: a C++ node does not tell its name. The proxies of a gateway that
    runs or is frozen are left alone, also if it has our name. The search ends after `PATIENCE`.

    Args:
        master_uri: URI of the master.
        node: our own node's name.
        gateway: our unique name.

    Raises:
        MasterError: the master does not answer. It may have been emptied in part.
    """
    master = MasterCaller(master_uri, node)
    rows = system_rows(master.call("getSystemState"))
    names = sorted({name for _, _, nodes in rows for name in nodes})
    dead = dict(_dead(master, node, names, gateway))
    for kind, name, nodes in rows:
        for proxy in dead.keys() & set(nodes):
            if kind == Kind.SERVICE:
                service_uri = str(master.call("lookupService", name))
                master.call_as(proxy, "unregisterService", name, service_uri)
            else:
                master.call_as(proxy, _UNREGISTER[kind], name, dead[proxy])
    return list(dead)


def _dead(
    master: MasterCaller, node: str, names: list[str], gateway: str
) -> Iterator[tuple[str, str]]:
    """Yields name and URI of each dead proxy."""
    own_name = gateway_in_proxy_uri(proxy_uri("", 0, gateway))
    until = time.monotonic() + PATIENCE
    for name in names:
        if time.monotonic() > until:
            return
        try:
            uri = str(master.call("lookupNode", name))
        except MasterError:
            continue  # it has been unregistered meanwhile
        found = gateway_in_proxy_uri(uri)
        if found and base_name(found) == base_name(own_name) and _is_dead(name, uri, node):
            yield name, uri


def _is_dead(proxy: str, uri: str, caller: str) -> bool:
    return refuses(uri) or name_of(uri, caller) not in (proxy, None)
