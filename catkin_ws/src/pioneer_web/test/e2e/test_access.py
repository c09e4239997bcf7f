"""Access control: a token is required, pages of another origin are refused, and a viewer can only watch."""

import json
import time

import pytest
from nav_msgs.msg import Odometry
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from pioneer_harness.wait import wait_until
from tcpros.client import Client

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

STOP = 1.0
"""A stop may take 0.2 s at most; this limit leaves room for a busy machine [s]."""
PATHS = (
    "/",
    "/map.png",
    "/metrics",
    "/static/main.js",
    "/cameras",
    "/doctor",
    "/recordings/x.mcap",
    "/docs",
)


def live(fleet, path="/live", **headers):
    return connect(
        fleet.url.replace("http", "ws") + path,
        additional_headers=headers,
        max_size=None,
        open_timeout=30,
    )


def ask(socket, **command):
    socket.send(json.dumps(command))
    return answer_from(socket)


def answer_from(socket):
    while True:
        frame = socket.recv(30)
        if isinstance(frame, str):
            return json.loads(frame)["answer"]


def subscribed(fleet):
    """Returns the topics that the page's node subscribes to."""
    return [
        topic for topic, nodes in fleet.master.system_state()[1].items() if "/fleet_page" in nodes
    ]


def test_nothing_is_subscribed_while_no_page_is_open(fleet):
    # The current rules: this topic is latched and rarely published.
    rest = ["/gateway/gateway_info"]
    assert subscribed(fleet) == rest
    with live(fleet, Cookie=fleet.login(fleet.viewer)) as socket:
        while b"pioneer2.scan" not in socket.recv(30):
            pass
        assert len(subscribed(fleet)) > 20
    wait_until(lambda: subscribed(fleet) == rest, "the end of all subscriptions", 60)


def test_a_stop_acts_at_once_and_holds_against_commands(fleet):
    client = Client(fleet.master.uri, "/test_of_stop")
    with (
        live(fleet, Cookie=fleet.login(fleet.token)) as socket,
        client.subscribe("/stand_in", "/pioneer2/odom") as odom,
    ):

        def speed():
            return Odometry().deserialize(odom.read_frame()).twist.twist.linear.x

        assert ask(socket, do="drive", robots=["pioneer2"], x=4.0, y=-2.0)["good"]
        while speed() < 0.5:
            pass
        began = time.monotonic()
        socket.send(json.dumps({"do": "stop", "robots": ["pioneer2"]}))
        while speed() != 0.0:
            pass
        took = time.monotonic() - began
        assert took < STOP
        assert answer_from(socket)["good"]
        # The robot's own computer keeps commanding until it learns that its waypoints were dropped.
        assert not ask(socket, do="drive", robots=["pioneer2"], x=0.0, y=0.0)["good"]
        assert ask(socket, do="release", robots=["pioneer2"])["good"]
        assert ask(socket, do="drive", robots=["pioneer2"], x=0.0, y=2.0)["good"]
        while speed() == 0.0:
            pass


@pytest.mark.parametrize("path", PATHS)
def test_an_unauthenticated_client_gets_401_and_no_data(fleet, path):
    status, _, body = fleet.request(path)
    assert status == 401
    assert b"pioneer1" not in body
    assert fleet.request(path, cookie="pioneer_18090=made-up")[0] == 401
    assert fleet.request(path, Authorization="Bearer wrong")[0] == 401


@pytest.mark.parametrize(
    "path",
    [
        "/live",
        "/foxglove",
        "/foxglove/wrong-token",
    ],
)
def test_an_unauthenticated_client_gets_no_socket(fleet, path):
    with pytest.raises(InvalidStatus), live(fleet, path):
        pass


def test_a_token_becomes_a_session_that_scripts_cannot_read(fleet):
    status, headers, body = fleet.request("/login", data=fleet.token.encode())
    assert (status, body) == (204, b"")
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=strict" in headers["Set-Cookie"]
    assert fleet.token not in headers["Set-Cookie"]
    status, headers, body = fleet.request("/", cookie=headers["Set-Cookie"].partition(";")[0])
    assert status == 200
    assert b"main.js" in body
    assert headers["X-Frame-Options"] == "DENY"
    assert fleet.request("/login", data=b"wrong")[0] == 401
    assert fleet.request("/login", data=b"x" * 100_000)[0] == 401


def test_odd_cookies_of_other_applications_on_this_host_lock_nobody_out(fleet):
    cookie = fleet.login(fleet.token)
    assert fleet.request("/", cookie=f"b/c@{{x}}=1; {cookie}")[0] in (200, 401)
    assert fleet.request("/map.png", cookie="a,b/c=1; d=2")[0] == 401
    status, _, _ = fleet.request("/", cookie="b/c=1", Authorization=f"Bearer {fleet.viewer}")
    assert status == 200


def test_a_page_of_another_origin_gets_no_socket_with_the_users_cookie(fleet):
    cookie = fleet.login(fleet.token)
    with (
        pytest.raises(InvalidStatus),
        live(fleet, Cookie=cookie, Origin="http://evil.example"),
    ):
        pass
    assert (
        fleet.request("/login", data=fleet.token.encode(), Origin="http://evil.example")[0] == 403
    )
    with live(fleet, Cookie=cookie, Origin=fleet.url) as socket:
        assert b"pioneer1.pose" in socket.recv(30)


def test_a_viewer_sees_and_cannot_command(fleet):
    with live(fleet, Cookie=fleet.login(fleet.viewer)) as socket:
        answer = ask(socket, do="stop", robots=["pioneer1"])
        assert answer == {"good": False, "text": "this session is read-only"}


@pytest.mark.parametrize(
    "command",
    [
        {},
        {"do": "drive", "robots": ["pioneer9"], "x": 0, "y": 0},
        {"do": "drive", "robots": ["pioneer1"], "x": 1e300, "y": 0},
    ],
)
def test_bad_commands_are_answered_with_what_is_wrong(fleet, command):
    with live(fleet, Cookie=fleet.login(fleet.token)) as socket:
        answer = ask(socket, **command)
        assert not answer["good"]
        assert answer["text"]


def test_figures_for_prometheus_come_with_the_viewers_token(fleet):
    def figures():
        return fleet.request("/metrics", Authorization=f"Bearer {fleet.viewer}")[2].decode()

    wait_until(lambda: 'pioneer_robot_up{robot="pioneer1"} 1.0' in figures(), "pioneer1 up", 60)
    assert "pioneer_real_time_factor 1.0" in figures()
    assert 'pioneer_rules{gateway="aadi1_gateway",state="active"} 2.0' in figures()


def test_nothing_is_logged_of_tokens(fleet):
    text = fleet.log.read_text()
    assert fleet.token not in text
    assert fleet.viewer not in text
