"""Reads topics of ROS 2 without rclpy, for types that it lacks: `read_dds JSON`, a list of `[TOPIC, TYPE]`.

Prints `begin` once every topic has been heard, and runs until it is ended.
"""

import json
import os
import sys
import threading

from roslib.message import get_message_class

from pioneer_ros2.dds import Participant, Reader
from pioneer_ros2.message import MessageTypes
from pioneer_ros2.rule import Qos


def main() -> int:
    """Entry point."""
    domain, topics = int(os.environ["ROS_DOMAIN_ID"]), json.loads(sys.argv[1])
    messages = MessageTypes(installed=lambda kind: str(get_message_class(kind)._full_text))
    participant = Participant(domain, "read_dds", messages, lambda: None)
    heard = [threading.Event() for _ in topics]
    readers = [
        Reader(
            participant, name, messages.converter(kind), Qos.RELIABLE, lambda _, e=event: e.set()
        )
        for (name, kind), event in zip(topics, heard, strict=True)
    ]
    for event in heard:
        event.wait()
    print("begin", flush=True)
    threading.Event().wait()
    del readers
    return 0


if __name__ == "__main__":
    sys.exit(main())
