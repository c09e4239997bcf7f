"""The former name of `pioneer_gazebo.world.pose`; kept for one release."""

import warnings

from pioneer_gazebo.world.pose import *  # noqa: F403

warnings.warn(
    "pioneer_gazebo.core.pose is now pioneer_gazebo.world.pose", DeprecationWarning, stacklevel=2
)
