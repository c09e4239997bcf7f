"""The switch of this package: ``PIONEER_FORK=0`` leaves ROS as it is."""

import os

SWITCH = "PIONEER_FORK"
"""Variable: 0 disables forking and all patches of ROS."""
LOCKSTEP_REFUSED = f"lockstep needs rospy's patches, which {SWITCH}=0 switches off: unset it, or run without lockstep"


class SwitchedOffError(Exception):
    """Something was asked for that is impossible without this package's patches."""


def is_on() -> bool:
    """Returns whether nodes may be forked and ROS be patched."""
    return os.environ.get(SWITCH) != "0"
