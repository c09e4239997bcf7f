"""A client of Foxglove's protocol reads topics unchanged, publishes, and calls services."""

import json
import struct
import threading
import time
from types import SimpleNamespace

import foxglove
import genpy.dynamic
import pytest
from foxglove_client import WAIT, Client, advertise, body, foxglove_client, publish
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import LaserScan
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import String
from std_srvs.srv import EmptyRequest
from tf2_msgs.msg import TFMessage
from websockets.sync.client import connect

from pioneer_web.state.robot import STALE

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_tf_and_scans_come_as_raw_ros1_with_their_definition(fleet):
    with foxglove_client(fleet.url, fleet.token) as one:
        one.await_topic("/tf", "/pioneer1/base_scan")
        channel = one.channels["/pioneer1/base_scan"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("ros1", "ros1msg")
        # A class generated from the channel's schema alone decodes the messages.
        reader = genpy.dynamic.generate_dynamic("sensor_msgs/LaserScan", channel["schema"])[
            "sensor_msgs/LaserScan"
        ]
        assert reader._md5sum == LaserScan._md5sum
        tf, scan = one.messages(tf="/tf", scan="/pioneer1/base_scan")
        assert TFMessage().deserialize(tf).transforms[0].header.frame_id in (
            "map",
            "pioneer1/odom",
            "pioneer2/odom",
        )
        assert len(reader().deserialize(scan).ranges) == 180


def test_a_client_takes_no_topic_away_from_the_page(fleet):
    """Publishers keep one connection per subscriber name: the page lost its own to another client of the same topic."""
    cookie, url = fleet.login(fleet.viewer), fleet.url.replace("http", "ws") + "/live"
    with connect(url, additional_headers={"Cookie": cookie}, max_size=None) as page:
        while b"pioneer1.scan" not in page.recv(WAIT):
            pass
        with foxglove_client(fleet.url, fleet.token) as one:
            one.await_topic("/pioneer1/odom")
            channel = one.channels["/pioneer1/odom"]["id"]
            one.send(op="subscribe", subscriptions=[{"id": 1, "channelId": channel}])
            while not isinstance(one.take(), bytes):
                pass
            ends = time.monotonic() + 2 * STALE
            while time.monotonic() < ends:
                row = json.loads(page.recv(WAIT)).get("pioneer1.row", {})
                assert not row.get("fault"), row["fault"]


def test_a_goal_that_a_client_publishes_reaches_the_robot(fleet):
    with foxglove_client(fleet.url, fleet.token) as one:
        advertise(one, 7, "/pioneer2/map_goal_pose", "geometry_msgs/PoseStamped")
        goal = PoseStamped()
        goal.header.frame_id, goal.pose.orientation.w = "map", 1.0
        goal.pose.position.x = -1.0
        publish(one, 7, goal)
        one.await_topic("/pioneer2/map_goal_client/queue")
        while (
            not WaypointQueue()
            .deserialize(one.messages(queue="/pioneer2/map_goal_client/queue")[0])
            .received
        ):
            pass


def test_services_are_called_and_failures_are_answered(fleet):
    with foxglove_client(fleet.url, fleet.token) as one:
        for name in ("/gazebo/pause_physics", "/gazebo/unpause_physics"):
            one.await_service(name)
            service = one.services[name]
            request = struct.pack("<BIII", 2, service["id"], 5, 4) + b"ros1" + body(EmptyRequest())
            one.socket.send(request)
            while not (isinstance(frame := one.take(), bytes) and frame[0] == 3):
                pass
            assert struct.unpack_from("<III", frame, 1) == (service["id"], 5, 4)
        one.socket.send(struct.pack("<BIII", 2, 9999, 6, 4) + b"ros1")
        assert one.await_op("serviceCallFailure")["callId"] == 6


def test_a_viewers_client_reads_and_cannot_publish(fleet):
    with foxglove_client(fleet.url, fleet.viewer) as one:
        assert one.info["capabilities"] == []
        one.await_topic("/pioneer1/base_scan")
        assert one.messages(scan="/pioneer1/base_scan")
        one.send(
            op="advertise",
            channels=[
                {"id": 1, "topic": "/pioneer1/map_goal", "schemaName": "geometry_msgs/Twist"}
            ],
        )
        assert "is read-only" in one.await_op("status")["message"]


def test_a_frame_that_breaks_the_protocol_is_answered_and_the_connection_lives(fleet):
    with foxglove_client(fleet.url, fleet.token) as one:
        for frame in (
            b"",
            b"\x09",
            b"\x01\x00",
            b"\x02" + b"\xff" * 12,
            "no json",
            "[]",
            '{"op": "subscribe", "subscriptions": [1]}',
        ):
            one.socket.send(frame)
            assert one.await_op("status")["level"] == 2
        one.await_topic("/tf")


def test_the_makers_own_server_is_read_by_the_same_client():
    """Checks the tests' client against the reference server: it reads that server as it reads ours."""
    subscribed = threading.Event()
    listener = SimpleNamespace(on_subscribe=lambda *_: subscribed.set())
    server = foxglove.start_server(port=0, supported_encodings=["ros1"], server_listener=listener)
    try:
        schema = foxglove.Schema(name="std_msgs/String", encoding="ros1msg", data=b"string data")
        channel = foxglove.Channel("/word", message_encoding="ros1", schema=schema)
        with connect(
            f"ws://127.0.0.1:{server.port}", subprotocols=["foxglove.sdk.v1"], open_timeout=WAIT
        ) as socket:
            one = Client(socket)
            one.await_topic("/word")
            one.send(
                op="subscribe", subscriptions=[{"id": 1, "channelId": one.channels["/word"]["id"]}]
            )
            assert subscribed.wait(WAIT)
            channel.log(body(String("raw")))
            while not (isinstance(frame := one.take(), bytes) and frame[0] == 1):
                pass
            assert String().deserialize(frame[13:]).data == "raw"
            assert one.channels["/word"].keys() >= {
                "encoding",
                "schemaName",
                "schema",
                "schemaEncoding",
            }
    finally:
        server.stop()
