"""The command-line tools. Each public function is an executable and returns its exit status.

The tools are not ROS nodes. They connect to the one gateway on the master in ROS_MASTER_URI. Exit status 2 means that
the command cannot be executed: invalid command line, no gateway, or more than one.
"""

import argparse
import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gateway_msgs import msg, srv

from rocon_gateway.commands import conversions, network
from rocon_gateway.commands.client import GatewayClient, NoGatewayError
from rocon_gateway.commands.table import listing, table
from rocon_hub_protocol.rule import Kind


def rules() -> int:
    """`rules`: prints a table of all rules with state and reason; returns 1 if any is not active."""
    options = _parsed(
        _with_json(
            argparse.ArgumentParser("rules", description="The state of each rule of this gateway.")
        )
    )
    return _run(lambda client: _rules(client, options.json))


def _rules(client: GatewayClient, as_json: bool) -> int:
    statuses = client.latched("rules", DiagnosticArray).status
    active = all(status.level == DiagnosticStatus.OK for status in statuses)
    if as_json:
        _say_json([{one.key: one.value for one in status.values} for status in statuses])
        return int(not active)
    rows = [_row(status) for status in statuses]
    if not rows:
        _say("the gateway has no rules")
        return 0
    _say(table(("ACTION", "GATEWAY", "TYPE", "NAME", "NODE", "STATE", "REASON"), rows))
    return int(not active)


def _row(status: DiagnosticStatus) -> tuple[str, ...]:
    values = {one.key: one.value for one in status.values}
    return tuple(
        values[key] or "-"
        for key in ("action", "gateway", "type", "name", "node", "state", "reason")
    )


def gateway_info() -> int:
    """`gateway_info`: prints the state of this master's gateway."""
    parser = argparse.ArgumentParser(
        "gateway_info", description="This master's gateway: its hubs, rules and connections."
    )
    options = _parsed(_with_json(parser))
    return _run(lambda client: _gateway_info(client, options.json))


def _gateway_info(client: GatewayClient, as_json: bool) -> int:
    info = client.latched("gateway_info", msg.GatewayInfo)
    if as_json:
        _say_json({"namespace": client.namespace, **conversions.plain_from_message(info)})
        return 0
    hubs = [f"{name} at {uri}" for name, uri in zip(info.hub_names, info.hub_uris, strict=False)]
    _say(
        f"gateway {info.name} ({client.namespace}) at {info.ip}, firewall {'on' if info.firewall else 'off'}"
    )
    _say(f"hub     {', '.join(hubs) or 'none yet'}")
    _say(listing("advertisement rules", [_text(rule) for rule in info.public_watchlist]))
    _say(listing("advertised", [_text(rule) for rule in info.public_interface]))
    _say(listing("flip rules", [_remote_text(one) for one in info.flip_watchlist]))
    flipped = [f"{_remote_text(one.remote_rule)}: {one.status}" for one in info.flipped_connections]
    _say(listing("flipped to others", flipped))
    _say(listing("flipped to here", [_remote_text(one) for one in info.flipped_in_connections]))
    _say(listing("pull rules", [_remote_text(one) for one in info.pull_watchlist]))
    _say(listing("pulled", [_remote_text(one) for one in info.pulled_connections]))
    return 0


def remote_gateway_info() -> int:
    """`remote_gateway_info [GATEWAY …]`: prints the other gateways on the hub; returns 1 if a named one is missing."""
    parser = argparse.ArgumentParser(
        "remote_gateway_info", description="The other gateways on the hub."
    )
    parser.add_argument(
        "gateways", nargs="*", metavar="GATEWAY", help="unique names; all if none is given"
    )
    options = _parsed(parser)

    def show(client: GatewayClient) -> int:
        found = client.call(
            "remote_gateway_info", srv.RemoteGatewayInfo, gateways=options.gateways
        ).gateways
        for one in found:
            _show_remote(one)
        missing = sorted(set(options.gateways) - {one.name for one in found})
        if missing:
            _complain(f"not on the hub: {', '.join(missing)}")
        elif not found:
            _say("there is no other gateway on the hub")
        return int(bool(missing))

    return _run(show)


def _show_remote(one: msg.RemoteGateway) -> None:
    seen = (
        ""
        if one.conn_stats.gateway_available
        else f", last heard of {one.conn_stats.time_since_last_seen} s ago"
    )
    _say(f"gateway {one.name} at {one.ip}, firewall {'on' if one.firewall else 'off'}{seen}")
    _say(listing("advertised", [_text(rule) for rule in one.public_interface]))
    _say(listing("flip rules", [_remote_text(rule) for rule in one.flipped_interface]))
    _say(listing("pull rules", [_remote_text(rule) for rule in one.pulled_interface]))


def advertise() -> int:
    """`advertise NAME …` or `advertise --all`: lets other gateways pull connections."""
    options = _request_options("advertise", "Lets other gateways pull connections of this one.")

    def ask(client: GatewayClient) -> int:
        if options.all:
            return _answer(
                client.call("advertise_all", srv.AdvertiseAll, cancel=options.cancel, blacklist=[])
            )
        return _answer(
            client.call(
                "advertise", srv.Advertise, cancel=options.cancel, rules=_rule_messages(options)
            )
        )

    return _run(ask)


def flip() -> int:
    """`flip GATEWAY NAME …` or `flip GATEWAY --all`: flips connections of this gateway to another."""
    return _remote(
        "flip", "Connects this gateway's publishers or subscribers with another gateway."
    )


def pull() -> int:
    """`pull GATEWAY NAME …` or `pull GATEWAY --all`: pulls connections that another gateway advertises."""
    return _remote("pull", "Brings here what another gateway advertises.")


def _remote(action: str, description: str) -> int:
    options = _request_options(action, description, gateway=True)

    def ask(client: GatewayClient) -> int:
        if options.all:
            fields = {"gateway": options.gateway, "blacklist": [], "cancel": options.cancel}
            return _answer(client.call(f"{action}_all", srv.RemoteAll, **fields))
        remotes = [msg.RemoteRule(options.gateway, rule) for rule in _rule_messages(options)]
        return _answer(client.call(action, srv.Remote, remotes=remotes, cancel=options.cancel))

    return _run(ask)


def _request_options(name: str, description: str, gateway: bool = False) -> argparse.Namespace:
    parser = argparse.ArgumentParser(name, description=description)
    if gateway:
        parser.add_argument("gateway", help="the other gateway's name, or a pattern")
    parser.add_argument("names", nargs="*", metavar="NAME", help="topics, or patterns of them")
    parser.add_argument(
        "-t",
        "--type",
        choices=list(map(str, Kind)),
        default=str(Kind.PUBLISHER),
        help="of connection",
    )
    parser.add_argument("-n", "--node", default="", help="the node, or a pattern; any if left out")
    parser.add_argument(
        "--all", action="store_true", help="everything, the blacklist's rules apart"
    )
    parser.add_argument("--cancel", action="store_true", help="take the rules back")
    options = _parsed(parser)
    if options.all == bool(options.names):
        parser.error("give names, or --all")
    return options


def _rule_messages(options: argparse.Namespace) -> list[msg.Rule]:
    return [msg.Rule(type=options.type, name=name, node=options.node) for name in options.names]


def _answer(response: Any) -> int:
    """Prints the result of a request; returns 1 if it was refused."""
    if response.result != msg.ErrorCodes.SUCCESS:
        _complain(f"refused ({response.result}): {response.error_message}")
        return 1
    _say("done; 'rosrun rocon_gateway rules' shows how the rules do")
    return 0


def graph() -> int:
    """`graph [--dot | --png FILE]`: prints or draws the whole network of the hub as text, Graphviz graph or picture."""
    parser = argparse.ArgumentParser(
        "graph", description="All gateways of the hub, with what goes between them."
    )
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--dot", action="store_true", help="in the language of Graphviz")
    kind.add_argument(
        "--png", metavar="FILE", help="as a picture; needs Graphviz (apt install graphviz)"
    )
    kind.add_argument(
        "--json",
        action="store_true",
        help="for programs: gateways, and arrows in the direction of data",
    )
    options = _parsed(parser)

    def show(client: GatewayClient) -> int:
        info = client.latched("gateway_info", msg.GatewayInfo)
        others = client.call("remote_gateway_info", srv.RemoteGatewayInfo).gateways
        members = [conversions.member_from_info(info), *map(conversions.member_from_remote, others)]
        hub = info.hub_names[0] if info.hub_names else ""
        if options.json:
            arrows = [
                {**dataclasses.asdict(one), "ends": one.ends} for one in network.arrows(members)
            ]
            _say_json({"hub": hub, "gateways": members, "arrows": arrows})
            return 0
        if options.png:
            return _draw(network.dot(hub, members), options.png)
        _say(network.dot(hub, members) if options.dot else network.text(hub, members))
        return 0

    return _run(show)


def _draw(text: str, path: str) -> int:
    program = shutil.which("dot")
    if program is None:
        _complain("a picture needs Graphviz: apt install graphviz; --dot works without it")
        return 2
    return subprocess.run(
        [program, "-Tpng", "-o", path], input=text.encode(), check=False
    ).returncode


def _run(work: Callable[[GatewayClient], int]) -> int:
    try:
        return work(GatewayClient())
    except NoGatewayError as error:
        _complain(str(error))
        return 2


def _parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    # roslaunch and rosrun users may append remappings to any command.
    return parser.parse_args(list(_without_remappings(sys.argv[1:])))


def _without_remappings(arguments: Iterable[str]) -> Iterable[str]:
    return (argument for argument in arguments if ":=" not in argument)


def _text(rule: msg.Rule) -> str:
    return f"{rule.type} {rule.name}" + (f" of {rule.node}" if rule.node else "")


def _remote_text(remote: msg.RemoteRule) -> str:
    return f"{remote.gateway}: {_text(remote.rule)}"


def _with_json(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    parser.add_argument("--json", action="store_true", help="for programs")
    return parser


def _say_json(content: object) -> None:
    _say(json.dumps(content, indent=2, ensure_ascii=False, default=dataclasses.asdict))


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")


def _complain(text: str) -> None:
    sys.stderr.write(text + "\n")
