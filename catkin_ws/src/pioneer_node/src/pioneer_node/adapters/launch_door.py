"""The optional package that patches rospy; it is built on this one, so it is imported by name."""

import functools
import importlib
from types import ModuleType


@functools.cache
def launch_door() -> ModuleType | None:
    """Returns ``pioneer_launch.door``; None if the workspace lacks that package: rospy then stays as it is."""
    try:
        return importlib.import_module("pioneer_launch.door")
    except ModuleNotFoundError as error:
        if error.name != "pioneer_launch":
            raise
        return None
