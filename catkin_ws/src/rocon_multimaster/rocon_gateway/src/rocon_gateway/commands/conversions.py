"""Converts the gateways' messages to values for the commands."""

from typing import Any

from gateway_msgs.msg import GatewayInfo, RemoteGateway
from gateway_msgs.msg import RemoteRule as RemoteRuleMessage
from gateway_msgs.msg import Rule as RuleMessage

from rocon_gateway.commands.network import Member
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule


def member_from_info(info: GatewayInfo) -> Member:
    """Returns our own gateway as a member of the network."""
    return Member(
        name=info.name,
        advertised=tuple(map(_rule, info.public_interface)),
        flips=tuple(map(_remote_rule, info.flip_watchlist)),
        pulls=tuple(map(_remote_rule, info.pull_watchlist)),
    )


def member_from_remote(remote: RemoteGateway) -> Member:
    """Returns another gateway as a member of the network."""
    return Member(
        name=remote.name,
        advertised=tuple(map(_rule, remote.public_interface)),
        flips=tuple(map(_remote_rule, remote.flipped_interface)),
        pulls=tuple(map(_remote_rule, remote.pulled_interface)),
        alive=remote.conn_stats.gateway_available,
    )


def _rule(message: RuleMessage) -> Rule:
    return Rule(Kind(message.type), message.name, message.node)


def _remote_rule(message: RemoteRuleMessage) -> RemoteRule:
    return RemoteRule(message.gateway, _rule(message.rule))


def plain_from_message(message: Any) -> dict[str, Any]:
    """Returns a message's fields as JSON-compatible values."""

    def plain(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [plain(one) for one in value]
        return plain_from_message(value) if hasattr(value, "__slots__") else value

    return {name: plain(getattr(message, name)) for name in message.__slots__}
