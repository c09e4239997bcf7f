import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcpros.http import MAX_HEAD, HttpError, http_message, http_request, http_response


@given(st.binary(max_size=300))
def test_a_request_and_a_response_are_read_as_written(body):
    for data in (http_request("host:1", "", body), http_response(body, keep_alive=False)):
        message = http_message(data, -1)
        assert data[message.start : message.end] == body
        assert message.end == len(data)
        assert not message.keep_alive


@given(st.binary(max_size=300))
def test_any_bytes_give_a_message_nothing_or_an_error(data):
    try:
        http_message(data, 0)
    except HttpError:
        return


def test_connections_are_kept_by_default_in_1_1_only():
    assert http_message(b"POST / HTTP/1.1\r\n\r\n", 0).keep_alive
    assert not http_message(b"POST / HTTP/1.0\r\n\r\n", 0).keep_alive


@pytest.mark.parametrize(
    "head",
    [
        b"GET / FTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
        b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
        b"x" * (MAX_HEAD + 10),
    ],
)
def test_what_is_too_long_or_unknown_is_refused(head):
    with pytest.raises(HttpError):
        http_message(head, 0)
