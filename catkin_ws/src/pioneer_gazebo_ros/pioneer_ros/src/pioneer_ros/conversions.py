"""Reads and writes velocity commands directly as the six doubles of a serialised Twist."""

import io
import struct
from typing import Self

from geometry_msgs.msg import Twist

from pioneer_ros.core.controller import ZERO, Command

_TWIST = struct.Struct("<6d")


class CommandMessage(Twist):  # type: ignore[misc]
    """A geometry_msgs/Twist that (de)serialises its six numbers at once, without Vector3 objects."""

    def __init__(self, command: Command = ZERO) -> None:
        super().__init__()
        self.command = command  #: the velocity

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes ``command``."""
        buff.write(_TWIST.pack(*self.command))

    def deserialize(self, data: bytes) -> Self:
        """Reads ``command`` from ``data``."""
        x, y, z, roll, pitch, yaw = _TWIST.unpack(data)
        self.command = (x, y, z, roll, pitch, yaw)
        return self
