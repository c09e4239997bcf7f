"""Converts rules and status reports to and from ROS messages."""

from collections.abc import Iterable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from gateway_msgs.msg import ConnectionStatistics, GatewayInfo, RemoteGateway
from gateway_msgs.msg import RemoteRule as RemoteRuleMessage
from gateway_msgs.msg import Rule as RuleMessage

from rocon_gateway.core.matching import rule_from_text
from rocon_gateway.core.network import Member
from rocon_gateway.core.rulebook import check_gateway
from rocon_gateway.core.situation import WORKING, Flipped, RuleState, State
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.record import Record
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule
from rocon_relay.core.connection import Export, Import, LinkStatus
from rocon_relay.core.latency import Latency
from rocon_relay.core.traffic import Flow


def rules_from_messages(messages: Iterable[RuleMessage], code: Code) -> list[Rule]:
    """Returns checked rules. Raises RequestError with `code`."""
    return [rule_from_text(message.type, message.name, message.node, code) for message in messages]


def remote_rules_from_messages(
    messages: Iterable[RemoteRuleMessage], code: Code
) -> list[RemoteRule]:
    """Returns checked remote rules. Raises RequestError with `code`."""
    found = []
    for message in messages:
        check_gateway(message.gateway, code)
        found += [
            RemoteRule(message.gateway, rule) for rule in rules_from_messages([message.rule], code)
        ]
    return found


def message_from_rule(rule: Rule | Connection) -> RuleMessage:
    """Returns the message of a rule; for a connection, that of the rule that matches exactly it."""
    return RuleMessage(type=str(rule.kind), name=rule.name, node=rule.node)


def message_from_remote_rule(remote: RemoteRule | Flipped) -> RemoteRuleMessage:
    """Returns a remote rule's message, or that of a connection with another gateway, without its status."""
    rule: Rule | Connection = remote.connection if isinstance(remote, Flipped) else remote.rule
    return RemoteRuleMessage(gateway=remote.gateway, rule=message_from_rule(rule))


def message_from_record(
    record: Record, silence: float, latency: Latency | None = None
) -> RemoteGateway:
    """Returns the message that describes another gateway.

    Args:
        record: its record.
        silence: time since it was last heard of [s], 0 if it is alive.
        latency: latency between our relay and its relay; None if unknown.
    """
    stats = ConnectionStatistics(
        gateway_available=silence == 0.0, time_since_last_seen=int(silence)
    )
    if latency is not None:
        stats.ping_latency_min, stats.ping_latency_max = (
            1e3 * latency.shortest,
            1e3 * latency.longest,
        )
        stats.ping_latency_avg, stats.ping_latency_mdev = (
            1e3 * latency.mean,
            1e3 * latency.deviation,
        )
    return RemoteGateway(
        name=record.name,
        ip=record.host,
        firewall=record.firewall,
        conn_stats=stats,
        public_interface=[message_from_rule(one) for one in record.advertisements],
        flipped_interface=[message_from_remote_rule(one) for one in record.flips],
        pulled_interface=[message_from_remote_rule(one) for one in record.pulls],
    )


def diagnostic_from_state(state: RuleState, gateway: str) -> DiagnosticStatus:
    """Returns the status of a rule of our gateway `gateway`, for `/diagnostics`."""
    word = state.verdict.state
    if word in WORKING:
        level = DiagnosticStatus.OK
    elif word == State.PENDING:
        level = DiagnosticStatus.STALE
    else:
        level = DiagnosticStatus.WARN
    target = f"{state.gateway} " if state.gateway else ""
    values = {
        "action": state.action,
        "gateway": state.gateway,
        "type": str(state.rule.kind),
        "name": state.rule.name,
        "node": state.rule.node,
        "state": word,
        "reason": state.verdict.reason,
    }
    return DiagnosticStatus(
        level=level,
        name=f"{gateway}: {state.action} {target}{state.rule}",
        message=f"{word}: {state.verdict.reason}" if state.verdict.reason else word,
        hardware_id=gateway,
        values=[KeyValue(key, value) for key, value in values.items()],
    )


def diagnostic_from_link(
    one: Export | Import,
    link: LinkStatus,
    flow: Flow,
    latencies: Mapping[str, Latency],
    gateway: str,
) -> DiagnosticStatus:
    """Returns status and data rates of one connection of our gateway `gateway`, for `/diagnostics`."""
    way, other = "to" if isinstance(one, Export) else "from", one.key.gateway
    latency = latencies.get(other)
    values = {
        "state": str(link.state),
        "reason": link.reason,
        "subscribers": link.subscribers,
        "messages": link.messages,
        "bytes": link.bytes,
        "rate [Hz]": f"{flow.messages:.1f}",
        "throughput [byte/s]": f"{flow.bytes:.0f}",
        "dropped": link.drops,
        "left out": link.left_out,
        "saved by compression [byte]": link.saved,
        "latency [ms]": f"{1e3 * latency.mean:.2f}" if latency else "",
    }
    node = f" of {one.key.source_node}" if one.key.source_node else ""
    working = str(link.state) in WORKING
    return DiagnosticStatus(
        level=DiagnosticStatus.OK if working else DiagnosticStatus.STALE,
        name=f"{gateway}: {way} {other} {one.key.topic}{node}",
        message=f"{link.state}, {flow.messages:.1f} messages a second"
        if working
        else f"{link.state}: {link.reason}",
        hardware_id=gateway,
        values=[KeyValue(key, str(value)) for key, value in values.items()],
    )


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
