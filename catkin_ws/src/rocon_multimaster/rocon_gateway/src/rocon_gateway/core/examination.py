"""What a gateway sees of its links, as a value and as the JSON that it answers the doctor with."""

import json
import re
from dataclasses import dataclass
from typing import Any

from rocon_gateway.core.error import GatewayError

MAX_TEXT = 512
"""A longer text in an answer is none of ours."""


class ExaminationError(GatewayError):
    """An answer that is not one of ours."""


@dataclass(frozen=True, slots=True)
class Contact:
    """An attempt to reach a TCP port."""

    what: str  #: whose port it is
    host: str  #: the host as it was named
    port: int  #: the port
    address: str = ""  #: what the name resolved to; empty if it did not
    error: str = ""  #: why the port was not reached; empty if it was


@dataclass(frozen=True, slots=True)
class Examination:
    """What one gateway sees."""

    gateway: str  #: its unique name
    clock: float  #: how far the hub's clock is ahead of its own [s]
    host_name: str  #: what the nodes of its master are known by: ROS_HOSTNAME, ROS_IP or the host's name
    host_address: str  #: what that resolves to there; empty if it does not
    python: str  #: the first `python3` on its PATH; empty if there is none
    python_works: bool  #: whether that imports rospy
    interpreter: str  #: the interpreter that runs the gateway
    #: one for each other gateway that lives, by unique name: its attempt to reach that one's relay
    contacts: tuple[Contact, ...] = ()


def is_request(text: str) -> bool:
    """Tells whether this is the number of a request: 32 hexadecimal digits."""
    return re.fullmatch("[0-9a-f]{32}", text) is not None


def text_from_examination(seen: Examination) -> str:
    """Returns the JSON text of an examination."""
    return json.dumps(
        {
            "gateway": seen.gateway,
            "clock": seen.clock,
            "name": [seen.host_name, seen.host_address],
            "python": [seen.python, seen.python_works, seen.interpreter],
            "links": [[one.what, one.host, one.port, one.address, one.error] for one in seen.contacts],
        },
        separators=(",", ":"),
    )


def examination_from_text(text: str | bytes) -> Examination:
    """Returns the examination in a JSON text. Raises ExaminationError."""
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
        gateway, float(clock), name, address, python, works, interpreter, tuple(Contact(*row) for row in rows)
    )


def _row(row: Any, *kinds: type) -> list[Any]:
    if not isinstance(row, list) or [type(cell) for cell in row] != list(kinds):
        raise ExaminationError(f"not a list of {', '.join(kind.__name__ for kind in kinds)}")
    # It is printed on a terminal, so it must not contain control sequences of an unauthenticated client.
    if any(isinstance(cell, str) and (len(cell) > MAX_TEXT or not cell.isprintable()) for cell in row):
        raise ExaminationError("a text is too long or not printable")
    return row
