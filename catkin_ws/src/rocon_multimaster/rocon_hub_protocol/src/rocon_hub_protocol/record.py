"""The documents that gateways write on the hub, as values and as JSON; see the gateway's protocol in the docs.

Data read from the hub are untrusted: each field is checked, and an invalid one raises an error that names it. Rows
with an invalid or too long ROS name are skipped.
"""

import enum
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from rocon_hub_protocol.code import HubProtocolError
from rocon_hub_protocol.rule import (
    LONGEST_NAME,
    Connection,
    Kind,
    RemoteRule,
    Rule,
    is_namespace,
    is_ros_name,
)

PROTOCOL = 2
"""Version of this protocol, stored in ``rocon:hub:protocol``."""

LONGEST_TEXT = 4096
"""Maximum length of a pattern or sentence read from a hub [characters]."""

Value = TypeVar("Value")


class RecordError(HubProtocolError):
    """An invalid document on the hub."""


@dataclass(frozen=True, slots=True)
class Record:
    """The public description of a gateway."""

    name: str  #: its unique name
    instance: str  #: changes with each start, so that a restart under the same name is detected
    host: str  #: its address for other gateways
    port: int  #: its relay's port
    firewall: bool = False  #: whether it refuses incoming flips
    advertisements: tuple[Connection, ...] = ()  #: local connections that others may pull
    flips: tuple[RemoteRule, ...] = ()  #: its flips, for information
    pulls: tuple[RemoteRule, ...] = ()  #: its pulls, for information
    namespace: str = ""  #: its robot's namespace; "" for none


class Purpose(enum.StrEnum):
    """The reason for an offer or a want."""

    FLIP = "flip"
    """Offer: the sender flips its publisher. Want: the sender flips a subscriber."""
    ANSWER = "answer"
    """Offer: answers the want of the receiver's flipped subscriber."""
    PULL = "pull"
    """Want: pulls an advertised publisher. Offer: feeds an advertised subscriber that the sender pulls."""
    SERVICE = "service"
    """Offer: the sender flips its service. Want: the sender pulls an advertised one."""
    PARAMETER = "parameter"
    """Want: the sender reads an advertised parameter."""


@dataclass(frozen=True, slots=True, order=True)
class Offer:
    """The sender's publisher or server, for the receiver to import."""

    topic: str  #: the topic, or the name of a service
    type: str  #: its message type; for a service, any
    node: str  #: the publishing or serving node
    purpose: Purpose  #: why it is offered
    to_node: str = ""  #: for a pulled subscriber, that subscriber's node; empty otherwise


@dataclass(frozen=True, slots=True, order=True)
class Want:
    """A connection that the receiver shall offer or export to the sender."""

    topic: str  #: the topic, or the name of a service or parameter
    node: str  #: pull: the publishing or serving node; flip: a pattern for the subscribing node, for information
    purpose: Purpose  #: any purpose


@dataclass(frozen=True, slots=True, order=True)
class Reply:
    """The reply to an offer or want."""

    kind: Kind  #: PUBLISHER for an offer, SUBSCRIBER for a want, SERVICE for the offer of a service
    topic: str  #: as in the offer or want
    node: str  #: as in the offer or want
    state: str  #: one of the words of rule states
    reason: str = ""  #: a readable sentence


@dataclass(frozen=True, slots=True)
class PeerRequest:
    """The complete request of one gateway to another; a new one replaces the old one."""

    offers: tuple[Offer, ...] = ()  #: publishers to import, at the receiver's discretion
    wants: tuple[Want, ...] = ()  #: connections to offer or export to the sender
    replies: tuple[Reply, ...] = ()  #: replies to the receiver's own request


NO_REQUEST = PeerRequest()
"""The empty request, which is never written."""


def is_text(value: object) -> bool:
    """Returns whether this is a string that can be sent: JSON allows lone surrogates, UTF-8 does not."""
    if not isinstance(value, str):
        return False
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def is_gateway_name(value: object) -> bool:
    """Returns whether this is a valid gateway name."""
    return is_text(value) and 0 < len(str(value)) <= LONGEST_NAME


def sound_namespaces(told: object) -> frozenset[str]:
    """Returns the valid robot namespaces in an untrusted list."""
    return frozenset(filter(is_namespace, told)) if isinstance(told, list) else frozenset()


def text_from_record(record: Record) -> str:
    """Returns the JSON text of a record."""
    return _text(
        {
            "name": record.name,
            "instance": record.instance,
            "host": record.host,
            "port": record.port,
            "firewall": record.firewall,
            "advertisements": [
                [one.kind, one.name, one.type, one.node] for one in record.advertisements
            ],
            "flips": [_row(one) for one in record.flips],
            "pulls": [_row(one) for one in record.pulls],
            "namespace": record.namespace,
        }
    )


def record_from_text(text: str | bytes) -> Record:
    """Parses the JSON text of a record. Raises RecordError."""
    document = _document(text)
    if not is_gateway_name(document.get("name")):
        raise RecordError(f"'name' is not a gateway's: {str(document.get('name'))[:40]!r}")
    return Record(
        name=_field(document, "name", str),
        instance=_field(document, "instance", str),
        host=_field(document, "host", str),
        port=_field(document, "port", int),
        firewall=_field(document, "firewall", bool),
        advertisements=_rows(
            document, "advertisements", 4, _connection, lambda r: _are_names(r[1], r[2], r[3])
        ),
        flips=_rows(document, "flips", 4, _remote, _are_short),
        pulls=_rows(document, "pulls", 4, _remote, _are_short),
        namespace=_field({"namespace": "", **document}, "namespace", str),
    )


def text_from_request(request: PeerRequest) -> str:
    """Returns the JSON text of a request."""
    return _text(
        {
            "offers": [
                [one.topic, one.type, one.node, one.purpose, one.to_node] for one in request.offers
            ],
            "wants": [[one.topic, one.node, one.purpose] for one in request.wants],
            "replies": [
                [one.kind, one.topic, one.node, one.state, one.reason] for one in request.replies
            ],
        }
    )


def request_from_text(text: str | bytes) -> PeerRequest:
    """Parses the JSON text of a request. Raises RecordError."""
    document = _document(text)
    return PeerRequest(
        offers=_rows(document, "offers", 5, _offer, lambda r: _are_names(r[0], r[1], r[2], r[4])),
        wants=_rows(document, "wants", 3, lambda r: Want(r[0], r[1], Purpose(r[2])), _is_want),
        replies=_rows(
            document, "replies", 5, lambda r: Reply(Kind(r[0]), r[1], r[2], r[3], r[4]), _are_short
        ),
    )


def _text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, separators=(",", ":"))


def _document(text: str | bytes) -> Mapping[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RecordError(f"not JSON: {error}") from None
    if not isinstance(document, dict):
        raise RecordError("not a JSON object")
    return document


def _field(document: Mapping[str, Any], name: str, kind: type[Value]) -> Value:
    value = document.get(name)
    if (
        not isinstance(value, kind)
        or (kind is int and isinstance(value, bool))
        or (kind is str and not is_text(value))
    ):
        raise RecordError(f"'{name}' is {value!r}, not a {kind.__name__}")
    return value


def _rows(
    document: Mapping[str, Any],
    name: str,
    length: int,
    build: Callable[[list[str]], Value],
    is_sound: Callable[[list[str]], bool],
) -> tuple[Value, ...]:
    rows = _field(document, name, list)
    try:
        return tuple(build(row) for row in (_strings(row, length) for row in rows) if is_sound(row))
    except ValueError as error:
        raise RecordError(f"'{name}': {error}") from None


def _strings(row: object, length: int) -> list[str]:
    if not isinstance(row, list) or len(row) != length or not all(is_text(cell) for cell in row):
        raise ValueError(f"{row!r} is not a list of {length} texts")
    return row


def _are_names(first: str, *others: str) -> bool:
    """Returns whether all are valid names; all but the first may also be empty or `*`, for any."""
    return is_ros_name(first) and all(one in ("", "*") or is_ros_name(one) for one in others)


def _are_short(row: list[str]) -> bool:
    return all(len(cell) <= LONGEST_TEXT for cell in row)


def _is_want(row: list[str]) -> bool:
    return is_ros_name(row[0]) and _are_short(row)


def _offer(row: list[str]) -> Offer:
    return Offer(row[0], row[1], row[2], Purpose(row[3]), row[4])


def _row(remote: RemoteRule) -> list[str]:
    return [remote.gateway, remote.rule.kind, remote.rule.name, remote.rule.node]


def _connection(row: list[str]) -> Connection:
    return Connection(Kind(row[0]), row[1], row[2], row[3])


def _remote(row: list[str]) -> RemoteRule:
    return RemoteRule(row[0], Rule(Kind(row[1]), row[2], row[3]))
