"""A gateway's examination of its links, as a value and as JSON for the doctor."""

import json
import re
from dataclasses import dataclass
from typing import Any

from rocon_gateway.error import GatewayError

MAX_TEXT = 512
"""Maximum length of a text in an answer [characters]; longer ones are invalid."""


class ExaminationError(GatewayError):
    """An invalid answer."""


@dataclass(frozen=True, slots=True)
class Contact:
    """An attempt to connect to a TCP port."""

    what: str  #: description of the port's owner
    host: str  #: the host as specified
    port: int  #: the port
    address: str = ""  #: the resolved address; empty if the name did not resolve
    error: str = ""  #: why the port was not reached; empty on success


@dataclass(frozen=True, slots=True)
class Examination:
    """The results of one gateway."""

    gateway: str  #: its unique name
    clock: float  #: how far the hub's clock is ahead of its own [s]
    host_name: str  #: host name advertised by the nodes of its master: ROS_HOSTNAME, ROS_IP or the host's name
    host_address: str  #: the address it resolves to there; empty if it does not resolve
    python: str  #: the first `python3` on its PATH; empty if there is none
    python_works: bool  #: whether that one can import rospy
    interpreter: str  #: the interpreter that runs the gateway
    #: one for each other live gateway, by unique name: the attempt to connect to its relay
    contacts: tuple[Contact, ...] = ()


def is_request(text: str) -> bool:
    """Returns whether this is a request id: 32 hexadecimal digits."""
    return re.fullmatch("[0-9a-f]{32}", text) is not None


def text_from_examination(seen: Examination) -> str:
    """Returns the JSON text of an examination."""
    return json.dumps(
        {
            "gateway": seen.gateway,
            "clock": seen.clock,
            "name": [seen.host_name, seen.host_address],
            "python": [seen.python, seen.python_works, seen.interpreter],
            "links": [
                [one.what, one.host, one.port, one.address, one.error] for one in seen.contacts
            ],
        },
        separators=(",", ":"),
    )


def examination_from_text(text: str | bytes) -> Examination:
    """Parses the JSON text of an examination. Raises ExaminationError."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ExaminationError(f"not JSON: {error}") from None
    if not isinstance(document, dict):
        raise ExaminationError("not a JSON object")
    clock = document.get("clock")
    if isinstance(clock, bool) or not isinstance(clock, int | float) or not abs(clock) < 1e12:
        raise ExaminationError("'clock' is not a number of seconds")
    links = document.get("links")
    if not isinstance(links, list):
        raise ExaminationError("'links' is not a list")
    rows = [_row(row, str, str, int, str, str) for row in links]
    (gateway,) = _row([document.get("gateway")], str)
    name, address = _row(document.get("name"), str, str)
    python, works, interpreter = _row(document.get("python"), str, bool, str)
    return Examination(
        gateway,
        float(clock),
        name,
        address,
        python,
        works,
        interpreter,
        tuple(Contact(*row) for row in rows),
    )


def _row(row: Any, *kinds: type) -> list[Any]:
    if not isinstance(row, list) or [type(cell) for cell in row] != list(kinds):
        raise ExaminationError(f"not a list of {', '.join(kind.__name__ for kind in kinds)}")
    # The text is printed on a terminal, so it must not contain control sequences from an unauthenticated client.
    if any(
        isinstance(cell, str) and (len(cell) > MAX_TEXT or not cell.isprintable()) for cell in row
    ):
        raise ExaminationError("a text is too long or not printable")
    return row
