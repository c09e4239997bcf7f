"""TLS, and the end of a session."""

import ssl
import subprocess
import threading
import time
from collections import deque

import pytest
from served import served
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)
HOURS = 0.002
"""Lifetime of a session: 7.2 s."""
CLOSED, NOT_LOGGED_IN = 4401, 401
WAIT = 60


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    make = ["rosrun", "rocon_gateway", "make_certificates", str(folder / "tls"), "127.0.0.1"]
    subprocess.run(make, check=True, capture_output=True, timeout=WAIT)
    context = ssl.create_default_context(cafile=folder / "tls" / "ca.crt")
    parameters = [f"_tls_directory:={folder / 'tls' / '127.0.0.1'}", f"_session_hours:={HOURS}"]
    with served(folder, parameters=parameters, scheme="https", context=context) as one:
        one.context = context
        yield one


def live(fleet, cookie, context=None, path="/live"):
    url = fleet.url.replace("http", "ws") + path
    return connect(
        url,
        additional_headers={"Cookie": cookie},
        ssl=context or fleet.context,
        max_size=None,
        open_timeout=WAIT,
    )


def test_the_page_comes_over_tls_and_its_cookie_goes_over_nothing_else(fleet):
    status, headers, _ = fleet.request("/login", data=fleet.token.encode())
    assert status == 204
    assert "; Secure" in headers["Set-Cookie"]
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert b"main.js" in fleet.request("/", cookie=cookie)[2]
    with live(fleet, cookie) as socket:
        assert b"pioneer1.row" in socket.recv(WAIT)
    with (
        pytest.raises(ssl.SSLCertVerificationError),
        live(fleet, cookie, ssl.create_default_context()),
    ):
        pass


def test_a_thousand_refused_connections_over_tls_hang_no_client(fleet):
    """One in some hundreds hung: a session ticket woke the client, which then read and wrote at the same time."""
    refused = []

    def connect_often():
        for _ in range(1000):
            with pytest.raises(InvalidStatus), live(fleet, "no cookie"):
                pass
            refused.append(True)

    thread = threading.Thread(target=connect_often, daemon=True)
    thread.start()
    thread.join(WAIT)
    assert len(refused) == 1000


@pytest.mark.parametrize("path", ["/live", "/foxglove"])
def test_a_session_that_expires_ends_its_stream_and_its_requests(fleet, path):
    began = time.monotonic()
    cookie = fleet.login(fleet.token)
    with live(fleet, cookie, path=path) as socket, pytest.raises(ConnectionClosedError):
        deque(socket, maxlen=0)
    assert time.monotonic() - began >= 3600 * HOURS
    assert socket.close_code == CLOSED
    assert fleet.request("/", cookie=cookie)[0] == NOT_LOGGED_IN
    with pytest.raises(InvalidStatus), live(fleet, cookie, path=path):
        pass
