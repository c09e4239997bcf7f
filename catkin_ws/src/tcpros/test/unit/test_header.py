import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcpros.header import (
    MAX_HEADER,
    MAX_TEXT,
    HeaderError,
    header_bytes,
    header_end,
    header_fields,
    printable,
)

keys = st.text(min_size=1, max_size=20).filter(lambda text: "=" not in text)


@given(st.dictionaries(keys, st.text(max_size=200), max_size=10))
def test_what_is_written_is_read_again(fields):
    data = header_bytes(fields)
    assert header_end(data) == len(data)
    assert header_fields(data[4:]) == fields


@given(st.binary(max_size=200))
def test_any_bytes_give_fields_or_a_header_error(body):
    try:
        fields = header_fields(body)
    except HeaderError:
        return
    assert all(fields)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_text_pass_unchanged(value):
    field = b"key=" + value
    body = len(field).to_bytes(4, "little") + field
    assert header_bytes(header_fields(body))[4:] == body


def test_the_end_is_unknown_before_the_length_is_there():
    assert header_end(b"\x01\x00\x00") == 0


@pytest.mark.parametrize("length", [MAX_HEADER + 1, 0xFFFFFFFF, int.from_bytes(b"POST", "little")])
def test_too_long_a_header_is_refused_by_its_length_alone(length):
    with pytest.raises(HeaderError):
        header_end(length.to_bytes(4, "little"))


def test_too_long_a_header_is_not_written():
    with pytest.raises(HeaderError):
        header_bytes({"definition": "x" * MAX_HEADER})


@given(st.text(st.characters(), max_size=50) | st.binary(max_size=50))
def test_any_text_of_a_peer_can_be_printed_and_sent(text):
    if isinstance(text, bytes):
        text = text.decode("utf-8", "surrogateescape")
    shown = printable(text)
    assert shown.isprintable()
    assert shown.encode().decode() == shown
    assert len(shown) == len(text)
    assert printable(shown) == shown


def test_a_long_text_of_a_peer_is_cut():
    assert printable("x" * 100_000) == "x" * (MAX_TEXT - 1) + "…"
