"""Hypothesis strategies for invalid input: almost valid data and plain garbage."""

import json
import struct
from collections.abc import Mapping
from typing import Any, TypeVar

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tcpros.header import MAX_HEADER, header_bytes

Drawn = TypeVar("Drawn")

ODD = (
    "",
    "/",
    "//",
    "/a b",
    "/\0",
    "/\ud800",
    "ü" * 300,
    "-1",
    "../..",
    "%s%n",
    "/a\n/b",
    "~x",
    "." * 5000,
    "(",
    "a" * 32,
)
texts = st.sampled_from((*ODD, "/flow", "/ghost", "robot", "base")) | st.text(max_size=12)
purposes = st.sampled_from(("flip", "answer", "pull", "service", "parameter")) | texts
kinds = (
    st.sampled_from(
        ("publisher", "subscriber", "service", "action_server", "action_client", "parameter")
    )
    | texts
)
scalars = st.none() | st.booleans() | st.integers() | st.floats() | texts
junk = st.recursive(
    scalars,
    lambda one: st.lists(one, max_size=3) | st.dictionaries(texts, one, max_size=3),
    max_leaves=8,
)


def _rows(*columns: st.SearchStrategy[str]) -> st.SearchStrategy[Any]:
    return st.lists(st.tuples(*columns).map(list), max_size=6) | junk


request_documents = st.fixed_dictionaries(
    {
        "offers": _rows(texts, texts, texts, purposes, texts),
        "wants": _rows(texts, texts, purposes),
        "replies": _rows(kinds, texts, texts, texts, texts),
    }
)
record_documents = st.fixed_dictionaries(
    {
        "name": texts,
        "instance": texts,
        "host": texts,
        "port": st.integers() | junk,
        "firewall": st.booleans() | junk,
        "advertisements": _rows(kinds, texts, texts, texts),
        "flips": _rows(texts, kinds, texts, texts),
        "pulls": _rows(texts, kinds, texts, texts),
    },
    optional={"namespace": texts},
)
"""Sound more often than not, so that what is inside is tried as well."""


def _text(document: Any) -> bytes:
    return json.dumps(document).encode()


requests = request_documents.map(_text) | st.binary(max_size=60) | junk.map(_text)
records = record_documents.map(_text) | st.binary(max_size=60) | junk.map(_text)

hellos = st.fixed_dictionaries(
    {},
    optional={
        "relay": st.sampled_from(("1", "2", "")),
        **dict.fromkeys(("topic", "service", "call", "parameter"), texts),
        **dict.fromkeys(
            ("type", "md5sum", "source_node", "source_gateway", "sink_gateway", "nonce"), texts
        ),
        **dict.fromkeys(
            ("gateways_passed", "rate", "queue_size", "compress", "tf_frames", "client.x"), texts
        ),
    },
)


def _framed(fields: Mapping[str, str]) -> bytes:
    sound = {key: value.encode("utf-8", "replace").decode() for key, value in fields.items()}
    return header_bytes(sound)


heads = (
    hellos.map(_framed)
    | st.binary(max_size=300)
    | st.tuples(st.integers(0, 2**32 - 1), st.binary(max_size=100)).map(
        lambda one: struct.pack("<I", one[0]) + one[1]
    )
    | st.sampled_from(
        (
            b"",
            b"GET / HTTP/1.1\r\n\r\n",
            b"POST " + b"x" * 20_000,
            struct.pack("<I", MAX_HEADER) + b"x" * 100,
        )
    )
)
"""What may come on the relay's port first: of a hello, of another protocol, of none."""


def drawn(strategy: st.SearchStrategy[Drawn], count: int) -> list[Drawn]:
    """Returns `count` examples, the same in every run, for a test that does not restart its subject for each."""
    found: list[Drawn] = []

    @settings(
        max_examples=count,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def collect(one: Drawn) -> None:
        found.append(one)

    collect()
    return found
