"""Prints the first transforms on a topic of ROS 2, [parent, child, x] each: frames.py DOMAIN TOPIC QOS.

Its types are its own, written from ROS 2's message definitions.
"""

import json
import sys
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from pioneer_ros2.dds import configuration

LIMIT = 20


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


def main() -> int:
    number, name, qos = sys.argv[1:]
    kept = Domain(int(number), configuration({}))
    participant = DomainParticipant(int(number))
    durability = (
        Policy.Durability.TransientLocal if qos == "latched" else Policy.Durability.Volatile
    )
    policies = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)), durability, Policy.History.KeepLast(1)
    )
    reader = DataReader(participant, Topic(participant, f"rt{name}", TFMessage), qos=policies)
    message = reader.take_one(timeout=duration(seconds=LIMIT))
    frames = [
        [each.header.frame_id, each.child_frame_id, each.transform.translation.x]
        for each in message.transforms
    ]
    sys.stdout.write(json.dumps(frames))
    del kept
    return 0


if __name__ == "__main__":
    sys.exit(main())
