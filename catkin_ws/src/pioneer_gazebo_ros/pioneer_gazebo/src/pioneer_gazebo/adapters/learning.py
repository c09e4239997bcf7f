"""The former name of `pioneer_gazebo.learning.environment`; kept for one release."""

import warnings

from pioneer_gazebo.learning.environment import *  # noqa: F403

warnings.warn(
    "pioneer_gazebo.adapters.learning is now pioneer_gazebo.learning.environment",
    DeprecationWarning,
    stacklevel=2,
)
