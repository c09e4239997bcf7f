"""Reads topics of ROS 2: `listen.py SECONDS JSON`, a list of `[TOPIC, TYPE, QOS]`; seconds of 0: until it is ended.

Prints `begin` once every topic has been heard and half a second has passed, and one line of JSON after the seconds:
messages a second, and the latency of those of the first topic, whose Headers have monotonic stamps. Messages are not
deserialised.
"""

import importlib
import json
import struct
import sys
import time
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

WARM_UP = 0.5
STAMP = struct.Struct("<iI")
STAMP_AT = 4
"""After the header of CDR."""
PROFILES = {
    "sensor": qos_profile_sensor_data,
    "reliable": QoSProfile(depth=10),
    "latched": QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}


class Listener:
    """Counts messages, and measures the latency of the first topic."""

    def __init__(self, node: Any, seconds: Any, topics: Any) -> None:
        self.seconds = seconds
        self.missing = {topic for topic, _, _ in topics}
        self.complete_at = self.began_at = 0.0
        self.count = 0
        self.delays: list[float] = []
        self.is_over = False
        for index, (topic, type_name, qos) in enumerate(topics):
            package, _, name = type_name.partition("/")
            kind = getattr(importlib.import_module(f"{package}.msg"), name)
            node.create_subscription(
                kind, topic, self.receiver(topic, not index), PROFILES[qos], raw=True
            )

    def receiver(self, topic: Any, is_timed: Any) -> Any:
        """Returns the function that takes a topic's messages."""

        def receive(data: Any) -> None:
            now = time.monotonic()
            self.missing.discard(topic)
            if self.missing or self.is_over:
                return
            self.complete_at = self.complete_at or now
            if now < self.complete_at + WARM_UP:
                return
            if not self.began_at:
                self.began_at = now
                print("begin", flush=True)
            self.count += 1
            if is_timed:
                seconds, nanoseconds = STAMP.unpack_from(data, STAMP_AT)
                self.delays.append(now - seconds - 1e-9 * nanoseconds)
            if self.seconds and now >= self.began_at + self.seconds:
                self.finish(now - self.began_at)

        return receive

    def finish(self, seconds: Any) -> None:
        """Prints the result."""
        self.is_over = True
        delays = sorted(self.delays)
        result = {
            "messages": self.count / seconds,
            "p50": delays[len(delays) // 2],
            "p99": delays[len(delays) * 99 // 100],
        }
        print(json.dumps(result), flush=True)


def main() -> None:
    """Entry point."""
    seconds, topics = float(sys.argv[1]), json.loads(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node("listener")
    listener = Listener(node, seconds, topics)
    while rclpy.ok() and not listener.is_over:
        rclpy.spin_once(node, timeout_sec=1.0)


if __name__ == "__main__":
    main()
