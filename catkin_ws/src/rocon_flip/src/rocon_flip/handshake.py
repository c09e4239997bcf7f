"""`test_sender` and `test_receiver`: round trips of messages prove that two gateways forward in both directions."""

import statistics
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import rospy
from std_msgs.msg import Bool, String

from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes import entry
from rocon_flip import rule_set
from rocon_flip.gateway_client import GatewayClient
from rocon_flip.rule_set import Action, RuleSetError

REPEAT = 0.2
"""Interval at which an unanswered message is repeated [s]: the links may still be starting."""


class HandshakeError(RuleSetError):
    """The handshake timed out, or the gateway refused the rules."""


@dataclass(frozen=True)
class SenderConfig:
    """Parameters of `test_sender`."""

    gateway: str = rule_set.HUB_GATEWAY  #: the gateway where `test_receiver` runs
    count: int = 10  #: number of messages that must come back
    timeout: float = 30.0  #: time-out for each message [s]

    def __post_init__(self) -> None:
        """Raises RuleSetError for invalid parameter values."""
        if not self.gateway or self.count < 1 or self.timeout <= 0:
            raise RuleSetError(
                "test_sender: ~gateway must be named, ~count at least 1, ~timeout greater than 0"
            )


class ReceiverNode:
    """Sends every message back.

    Subscribes: `/handshake/ping` (String). Publishes: `/handshake/pong` (String).

    Parameters, services: none. Threads: rospy's. On error: not applicable.
    """

    def __init__(self) -> None:
        self._known: set[str] = set()
        self._pong = rospy.Publisher(rule_set.PONG, String, queue_size=10)
        self._ping = rospy.Subscriber(rule_set.PING, String, self._answer, queue_size=10)
        rospy.loginfo("waiting for a test_sender")

    def _answer(self, ping: String) -> None:
        sender = ping.data.partition(" ")[0]
        if sender not in self._known:
            self._known.add(sender)
            rospy.loginfo("handshake with sender %s", sender)
        self._pong.publish(ping)


class SenderNode:
    """Flips one topic each way, counts the messages that return, removes the rules and ends.

    Publishes: `/handshake/ping` (String). Subscribes: `/handshake/pong` (String).

    Parameters: the fields of `SenderConfig`, private. Services: calls the gateway's `flip`.

    Threads: the main thread sends, rospy's threads receive. On error: logs one line with a hint; exit status 1.
    """

    def __init__(self) -> None:
        self._config = config_from_mapping(SenderConfig, entry.parameters(), rospy.get_name())
        self._id = uuid.uuid4().hex[:8]
        self._arrived = threading.Condition()
        self._last = -1
        self._ping = rospy.Publisher(rule_set.PING, String, queue_size=10)
        self._pong = rospy.Subscriber(rule_set.PONG, String, self._take, queue_size=10)

    def spin(self) -> None:
        """Performs the handshake."""
        client = GatewayClient()
        client.wait()
        wishes = rule_set.handshake(self._config.gateway)
        if not client.ask(Action.FLIP, wishes):
            raise HandshakeError("test_sender: the gateway refused")
        try:
            times = [self._round_trip(number) for number in range(self._config.count)]
        finally:
            if not rospy.is_shutdown():
                client.ask(Action.FLIP, wishes, cancel=True)
        text = "handshake with %s: %d messages there and back, median %.1f ms"
        rospy.loginfo(text, self._config.gateway, len(times), 1000 * statistics.median(times))

    def _round_trip(self, number: int) -> float:
        """Returns the round-trip time of message `number` [s], measured from its last transmission."""
        deadline = time.monotonic() + self._config.timeout
        while time.monotonic() < deadline:
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("shutdown")
            sent = time.monotonic()
            self._ping.publish(String(f"{self._id} {number}"))
            with self._arrived:
                if self._arrived.wait_for(lambda: self._last >= number, REPEAT):
                    return time.monotonic() - sent
        raise HandshakeError(
            f"test_sender: message {number} did not come back from '{self._config.gateway}' within "
            f"{self._config.timeout:g} s. Does test_receiver run there? 'rosrun rocon_gateway rules' says more"
        )

    def _take(self, pong: String) -> None:
        sender, _, number = pong.data.partition(" ")
        # Other senders may use the same receiver.
        if sender == self._id and number.isdigit():
            with self._arrived:
                self._last = max(self._last, int(number))
                self._arrived.notify()


class OriginalPublisherNode:
    """The original `original_msg_publisher`: publishes a greeting and acknowledges each answer.

    Publishes: `original_message` (String, latched), `msg_ack` (Bool, latched).
    Subscribes: `/receiver/handshake` (String).

    Parameters, services: none. Threads: rospy's. On error: not applicable.
    """

    def __init__(self) -> None:
        self._greeting = rospy.Publisher("original_message", String, queue_size=10, latch=True)
        self._acknowledgement = rospy.Publisher("msg_ack", Bool, queue_size=10, latch=True)
        self._answers = rospy.Subscriber(
            "/receiver/handshake", String, self._acknowledge, queue_size=10
        )
        self._greeting.publish(String("Hello from the sender!"))

    def _acknowledge(self, answer: String) -> None:
        rospy.loginfo("received from the remote gateway: %s", answer.data)
        self._acknowledgement.publish(Bool(True))


class MessageReceiverNode:
    """The original `msg_receiver`, the counterpart of `original_msg_publisher`.

    Subscribes: `/original_message` (String). Publishes: `handshake` (String, latched).

    Parameters, services: none. Threads: rospy's. On error: not applicable.
    """

    def __init__(self) -> None:
        self._answer = rospy.Publisher("handshake", String, queue_size=10, latch=True)
        self._greetings = rospy.Subscriber("/original_message", String, self._take, queue_size=10)

    def _take(self, greeting: String) -> None:
        rospy.loginfo("received from the remote gateway: %s", greeting.data)
        self._answer.publish(String("Hello from the receiver!"))


_NODES: Mapping[str, Callable[[], object]] = {
    "original_msg_publisher": OriginalPublisherNode,
    "msg_receiver": MessageReceiverNode,
    "test_sender": SenderNode,
    "test_receiver": ReceiverNode,
}


def main() -> int:
    """Runs the node with this program's name; returns its exit status."""
    name = Path(sys.argv[0]).name
    return entry.run(name, _NODES[name], (RuleSetError,), wall_time=True)
