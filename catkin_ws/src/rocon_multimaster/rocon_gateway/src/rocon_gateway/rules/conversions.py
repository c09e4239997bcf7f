"""Converts rules and their states to and from ROS messages."""

from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from gateway_msgs.msg import RemoteRule as RemoteRuleMessage
from gateway_msgs.msg import Rule as RuleMessage

from rocon_gateway.rules.matching import rule_from_text
from rocon_gateway.rules.rulebook import check_gateway
from rocon_gateway.rules.situation import WORKING, Flipped, RuleState, State
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import Connection, RemoteRule, Rule


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


def diagnostic_from_state(state: RuleState, gateway: str) -> DiagnosticStatus:
    """Returns the status of a rule of our gateway `gateway`, for `/diagnostics`."""
    word = state.verdict.state
    if word in WORKING - {State.MTU}:
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
