"""Message classes for plans held as arrays."""

import io
from typing import Any

import numpy as np
from nav_msgs.msg import Path
from nav_msgs.srv import (
    GetPlan,
    GetPlanResponse,
)
from numpy.typing import NDArray
from std_msgs.msg import Header

from nav_bundle.base.conversions import pose_fields, write_at_end
from pioneer_node.core.frame import stripped


class PathMessage(Path):  # type: ignore[misc]
    """A Path serialised from an array, because creating hundreds of PoseStamped objects takes milliseconds."""

    def __init__(self, track: NDArray[np.float64], frame: str, stamp: Any) -> None:
        super().__init__(Header(0, stamp, stripped(frame)), [])
        self.track = track  #: poses (x, y [m], yaw [rad]), shape (n, 3), in the header's frame and at its stamp

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the header and the track's poses."""
        super().serialize(buff)
        frame = self.header.frame_id.encode()
        head = [("seq", "<u4"), ("secs", "<u4"), ("nsecs", "<u4"), ("length", "<u4")]
        records = np.zeros(
            len(self.track), np.dtype([*head, ("frame", f"V{len(frame)}"), ("pose", "<f8", 7)])
        )
        records["secs"], records["nsecs"] = self.header.stamp.secs, self.header.stamp.nsecs
        records["length"], records["frame"] = len(frame), np.void(frame)
        records["pose"] = pose_fields(self.track)
        write_at_end(buff, records)


class GetPlanArrayResponse(GetPlanResponse):  # type: ignore[misc]
    """A GetPlan response that holds a ``PathMessage``. For services."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Writes the response: only the plan."""
        self.plan.serialize(buff)


class GetPlanArray(GetPlan):  # type: ignore[misc]
    """nav_msgs/GetPlan whose response is serialised from an array."""

    _response_class = GetPlanArrayResponse
