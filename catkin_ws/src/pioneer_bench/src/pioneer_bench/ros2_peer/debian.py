"""ROS 1 beside ROS 2 in one interpreter, although both have packages of the same names."""

import importlib
import sys
from typing import Any

DEBIAN = "/usr/lib/python3/dist-packages"


def imported(*names: Any) -> Any:
    """Returns modules of Debian's ROS 1. The names of message packages mean those of ROS 2 afterwards, as before."""
    of_ros2 = _without_message_packages()
    sys.path.insert(0, DEBIAN)
    try:
        return [importlib.import_module(name) for name in names]
    finally:
        sys.path.remove(DEBIAN)
        _without_message_packages()
        sys.modules.update(of_ros2)


def _without_message_packages() -> Any:
    """Takes the message packages out of the loaded modules and returns them."""
    names = [name for name in sys.modules if name.partition(".")[0].endswith("_msgs")]
    return {name: sys.modules.pop(name) for name in names}
