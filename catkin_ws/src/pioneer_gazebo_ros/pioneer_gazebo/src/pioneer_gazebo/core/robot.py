"""The former name of `pioneer_gazebo.world.robot`; kept for one release."""

import warnings

from pioneer_gazebo.world.robot import *  # noqa: F403

warnings.warn(
    "pioneer_gazebo.core.robot is now pioneer_gazebo.world.robot", DeprecationWarning, stacklevel=2
)
