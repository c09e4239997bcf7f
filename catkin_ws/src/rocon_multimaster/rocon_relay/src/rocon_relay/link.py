"""The link protocol: handshake and control frames between two relays. See `docs/gateway.md`."""

import hashlib
import hmac
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rocon_relay.connection import ANY, LinkState, Subject
from rocon_relay.error import RelayError
from rocon_relay.option import NO_OPTIONS, LinkOptions, OptionError, options_from_fields
from rocon_relay.path import MAX_PROBE
from tcpros.header import header_bytes, printable

VERSION = "2"


class LinkError(RelayError):
    """A peer violates the link protocol or uses an unsupported version."""


class AskError(LinkError):
    """A peer requests something invalid; the link is refused."""


LONGEST_ROUND_TRIP = 60.0
"""Reported round trips of this length or more are ignored [s]."""

CLIENT = "client."
"""Prefix of the fields that a call forwards from its client."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The first header on a link, sent by the import side. The attributes are its fields."""

    topic: str  #: the name of the topic, service or parameter
    type: str
    md5sum: str
    source_node: str
    source_gateway: str
    sink_gateway: str
    gateways_passed: tuple[str, ...]
    nonce: str
    subject: Subject = Subject.TOPIC
    keys: tuple[str, ...] = ()  #: names of the keys we have, preferred one first
    client: tuple[
        tuple[str, str], ...
    ] = ()  #: for a call, the sorted fields of the client's connection header
    options: LinkOptions = (
        NO_OPTIONS  #: for a topic, the sink's options; one field for each enabled option
    )
    probe: int = (
        0  #: length that the welcome shall have at least [bytes], to check the path; 0 for no check
    )

    def fields(self) -> dict[str, str]:
        """Returns the fields of the connection header."""
        return {
            "relay": VERSION,
            self.subject: self.topic,
            "type": self.type,
            "md5sum": self.md5sum,
            "source_node": self.source_node,
            "source_gateway": self.source_gateway,
            "sink_gateway": self.sink_gateway,
            "gateways_passed": _joined(self.gateways_passed),
            "nonce": self.nonce,
            "keys": ",".join(self.keys),
            **self.options.fields(),
            **({"probe": str(self.probe)} if self.probe else {}),
            **{CLIENT + key: value for key, value in self.client},
        }

    @classmethod
    def from_fields(cls, fields: Mapping[str, str]) -> "Hello":
        """Parses the fields of a connection header.

        Raises:
            AskError: its options are invalid.
            LinkError: the version differs, or a field is missing.
        """
        if fields.get("relay") != VERSION:
            raise LinkError(f"it does not speak version {VERSION} of the link protocol")
        subject = next((one for one in Subject if one in fields), Subject.TOPIC)
        client = (
            (key.removeprefix(CLIENT), value)
            for key, value in fields.items()
            if key.startswith(CLIENT)
        )
        try:
            return cls(
                fields[subject],
                fields["type"],
                fields["md5sum"],
                fields["source_node"],
                fields["source_gateway"],
                fields["sink_gateway"],
                _split(fields["gateways_passed"]),
                fields["nonce"],
                subject,
                tuple(filter(None, fields["keys"].split(","))),
                tuple(sorted(client)),
                options_from_fields(fields),
                probe_from_field(fields.get("probe", "")),
            )
        except KeyError as error:
            raise LinkError(f"its hello lacks the field {error.args[0]}") from None
        except OptionError as error:
            raise AskError(f"options that cannot be had: {error}") from None


def _joined(names: Iterable[str]) -> str:
    """Returns names in one field, separated by commas; a gateway's name may hold commas itself."""
    return ",".join(name.replace("%", "%25").replace(",", "%2C") for name in names)


def _split(field: str) -> tuple[str, ...]:
    names = (name.replace("%2C", ",").replace("%25", "%") for name in field.split(","))
    return tuple(filter(None, names))


def state_from_field(word: str) -> LinkState:
    """Returns the state of that name; `REFUSED` for an unknown name."""
    return LinkState(word) if word in set(LinkState) else LinkState.REFUSED


def limit_from_fields(fields: Mapping[str, str]) -> str:
    """Returns the rate limit in a welcome as readable text; "" if there is none."""
    rate = printable(fields.get("rate", "")[:24])
    return f"at most {rate.removesuffix('.0')} messages a second" if rate else ""


def seconds_from_field(text: str) -> float:
    """Parses a round-trip time reported by the peer [s]; returns 0 if it is invalid."""
    try:
        seconds = float(text)
    except ValueError:
        return 0.0
    return seconds if 0 < seconds < LONGEST_ROUND_TRIP else 0.0


def probe_from_field(text: str) -> int:
    """Parses the length of a probe [bytes]; returns 0 if it is invalid or longer than `MAX_PROBE`."""
    is_number = text.isascii() and text.isdigit() and len(text) <= len(str(MAX_PROBE))
    return int(text) if is_number and int(text) <= MAX_PROBE else 0


def mismatch(wanted_type: str, wanted_md5sum: str, type_: str, md5sum: str) -> str:
    """Returns how type or MD5 sum differ from the wanted ones, "" if they match."""
    if ANY not in (wanted_type, type_) and wanted_type != type_:
        return printable(f"the type here is {type_}, asked for was {wanted_type}")
    if ANY not in (wanted_md5sum, md5sum) and wanted_md5sum != md5sum:
        return printable(
            f"the definition of {type_} differs: MD5 sum {md5sum} here, {wanted_md5sum} asked for"
        )
    return ""


def proof(key: bytes, role: str, hello: Mapping[str, str], challenge: str) -> str:
    """Returns the proof that we know a key, valid only for this hello and challenge.

    Args:
        key: the fleet's key.
        role: "source" or "sink", so that neither side can send the other's proof back.
        hello: its fields in the order sent, unknown ones included; its nonce is the sink's challenge to the source.
        challenge: the source's challenge to the sink.
    """
    text = f"{role}\n{challenge}\n".encode() + header_bytes(hello)
    return hmac.new(key, text, hashlib.sha256).hexdigest()


def is_proof(given: str, expected: str) -> bool:
    """Returns, in constant time, whether a proof is correct; always False if `expected` is empty."""
    return expected != "" and hmac.compare_digest(
        given.encode("utf-8", "replace"), expected.encode()
    )
