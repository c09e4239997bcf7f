"""Prints one message of the custom type on a topic of ROS 2, which this reader declares itself: leg.py DOMAIN TOPIC."""

import json
import sys
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, sequence, uint8
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from pioneer_ros2.dds import configuration

LIMIT = 20


@dataclass
class Leg(IdlStruct, typename="walker_msgs::msg::dds_::Leg_"):
    name: str
    reach: array[float64, 2]
    toes: sequence[uint8]


def main() -> int:
    number, name = sys.argv[1:]
    kept = Domain(int(number), configuration({}))
    participant = DomainParticipant(int(number))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1))
    reader = DataReader(participant, Topic(participant, f"rt{name}", Leg), qos=qos)
    message = reader.take_one(timeout=duration(seconds=LIMIT))
    sys.stdout.write(json.dumps([message.name, list(message.reach), list(message.toes)]))
    del kept
    return 0


if __name__ == "__main__":
    sys.exit(main())
