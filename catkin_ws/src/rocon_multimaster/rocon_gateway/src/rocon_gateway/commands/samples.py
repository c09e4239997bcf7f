"""One function for each service of a gateway, with rocon's names and arguments: `advertise_all`, `flip_tutorials`, …

The caller must have initialised its node. The tutorial's five connections are the talker's and listener's /chatter,
/add_two_ints, and both sides of /fibonacci.
"""

from typing import Any

import rospy
from gateway_msgs import msg, srv

from rocon_gateway.error import GatewayError

NAMESPACE = "/gateway"
HUB_URI = "http://localhost:6380"
_CONNECT_TIMEOUT = 30.0
_TUTORIALS = {
    msg.ConnectionType.PUBLISHER: ("/chatter", ".*ter", "/t.*er"),
    msg.ConnectionType.SUBSCRIBER: ("/chatter", ".*ter", ""),
    msg.ConnectionType.SERVICE: ("/add_two_ints", "/add_two_.*", ""),
    msg.ConnectionType.ACTION_CLIENT: ("/fibonacci/client", "/fibonacci/cli.*", ""),
    msg.ConnectionType.ACTION_SERVER: ("/fibonacci/server", "/fibonacci/ser.*", ""),
}
"""For each type the plain name, and patterns for name and node that match it."""


class GatewaySampleRuntimeError(GatewayError):
    """The gateway refused the request, or knows no other gateway."""


def _ask(ns: str, service: str, kind: Any, what: str, **fields: Any) -> Any:
    name = f"{ns}/{service}"
    rospy.wait_for_service(name)
    response = rospy.ServiceProxy(name, kind)(**fields)
    if response.result != msg.ErrorCodes.SUCCESS:
        raise GatewaySampleRuntimeError(
            f"{what} failed: {response.error_message} (error {response.result})"
        )
    return response


def _tutorial_rules(regex_patterns: bool) -> list[msg.Rule]:
    return [
        msg.Rule(kind, pattern, node) if regex_patterns else msg.Rule(kind, name, "")
        for kind, (name, pattern, node) in _TUTORIALS.items()
    ]


def find_first_remote_gateway(ns: str = NAMESPACE) -> str:
    """Returns the name of another gateway on the hub; raises GatewaySampleRuntimeError if there is none."""
    name = f"{ns}/remote_gateway_info"
    rospy.wait_for_service(name)
    found = rospy.ServiceProxy(name, srv.RemoteGatewayInfo)([]).gateways
    if not found:
        raise GatewaySampleRuntimeError("there are no other gateways on the hub")
    return str(found[0].name)


def connect_hub_by_service(
    ns: str = NAMESPACE, raise_exception: bool = True, uri: str = HUB_URI
) -> tuple[int, str]:
    """Connects the gateway to the hub at ``uri``; returns the service's result and error message.

    Raises:
        GatewaySampleRuntimeError: the request is refused and ``raise_exception`` is set.
    """
    name = f"{ns}/connect_hub"
    rospy.wait_for_service(name, _CONNECT_TIMEOUT)
    response = rospy.ServiceProxy(name, srv.ConnectHub)(uri)
    if response.result != msg.ErrorCodes.SUCCESS and raise_exception:
        raise GatewaySampleRuntimeError(
            f"cannot connect to the hub at {uri}: {response.error_message}"
        )
    return response.result, response.error_message


def advertise_all(cancel: bool = False, ns: str = NAMESPACE) -> None:
    """Advertises everything that is not blacklisted; ``cancel`` ends that."""
    _ask(ns, "advertise_all", srv.AdvertiseAll, "advertise_all", cancel=cancel, blacklist=[])


def advertise_tutorials(
    cancel: bool = False, regex_patterns: bool = False, ns: str = NAMESPACE
) -> None:
    """Advertises the tutorial's connections, by their names or by patterns."""
    rules = _tutorial_rules(regex_patterns)
    _ask(ns, "advertise", srv.Advertise, "advertise", cancel=cancel, rules=rules)


def _all(service: str, gateway: str | None, cancel: bool, ns: str) -> None:
    remote = gateway or find_first_remote_gateway(ns)
    _ask(
        ns,
        service,
        srv.RemoteAll,
        f"{service} with {remote}",
        gateway=remote,
        cancel=cancel,
        blacklist=[],
    )


def _tutorials(
    service: str, gateway: str | None, cancel: bool, regex_patterns: bool, ns: str
) -> None:
    remote = gateway or find_first_remote_gateway(ns)
    remotes = [msg.RemoteRule(remote, rule) for rule in _tutorial_rules(regex_patterns)]
    _ask(ns, service, srv.Remote, f"{service} with {remote}", cancel=cancel, remotes=remotes)


def pull_all(
    remote_gateway_name: str | None = None, cancel: bool = False, ns: str = NAMESPACE
) -> None:
    """Pulls everything that a gateway advertises, by default the first one."""
    _all("pull_all", remote_gateway_name, cancel, ns)


def pull_tutorials(
    remote_gateway_name: str | None = None,
    cancel: bool = False,
    regex_patterns: bool = False,
    ns: str = NAMESPACE,
) -> None:
    """Pulls the tutorial's connections from a gateway, by default the first one."""
    _tutorials("pull", remote_gateway_name, cancel, regex_patterns, ns)


def flip_all(
    remote_gateway_name: str | None = None, cancel: bool = False, ns: str = NAMESPACE
) -> None:
    """Flips everything to a gateway, by default the first one."""
    _all("flip_all", remote_gateway_name, cancel, ns)


def flip_tutorials(
    remote_gateway_name: str | None = None,
    cancel: bool = False,
    regex_patterns: bool = False,
    ns: str = NAMESPACE,
) -> None:
    """Flips the tutorial's connections to a gateway, by default the first one."""
    _tutorials("flip", remote_gateway_name, cancel, regex_patterns, ns)
