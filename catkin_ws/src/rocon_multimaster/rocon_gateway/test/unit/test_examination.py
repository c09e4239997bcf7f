"""What gateways answer the doctor: valid answers are read as written, and anything else is refused."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rocon_gateway.doctor.examination import (
    Contact,
    Examination,
    ExaminationError,
    examination_from_text,
    is_request,
    text_from_examination,
)

names = st.text(st.characters(blacklist_categories=("C", "Z")), max_size=20)
contacts = st.builds(Contact, names, names, st.integers(0, 65535), names, names)
examinations = st.builds(
    Examination,
    names,
    st.floats(-1e6, 1e6),
    names,
    names,
    names,
    st.booleans(),
    names,
    st.lists(contacts, max_size=5).map(tuple),
)
documents = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=5)
        | st.dictionaries(st.sampled_from(["gateway", "clock", "name", "python", "links"]), inner)
    ),
)


@given(examinations)
def test_what_is_written_is_read_again(seen: Examination) -> None:
    assert examination_from_text(text_from_examination(seen)) == seen


@given(st.binary(max_size=100) | documents.map(lambda one: json.dumps(one).encode()))
def test_what_an_unknown_host_answers_is_read_or_refused(text: bytes) -> None:
    try:
        examination_from_text(text)
    except ExaminationError:
        return


@pytest.mark.parametrize("name", ["\x1b[2J", "a\nb", "x" * 600])
def test_without_a_terminal_the_error_says_what_to_do(name: str) -> None:
    text = text_from_examination(Examination(name, 0.0, "", "", "", True, ""))
    with pytest.raises(ExaminationError):
        examination_from_text(text)


def test_a_request_is_32_hexadecimal_digits() -> None:
    assert is_request("0123456789abcdef" * 2)
    assert not any(map(is_request, ["", "rocon:examine", "0" * 33, "G" * 32]))
