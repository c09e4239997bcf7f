"""The former name of `pioneer_gazebo.learning.training`; kept for one release."""

import warnings

from pioneer_gazebo.learning.training import *  # noqa: F403
from pioneer_gazebo.learning.training import main

warnings.warn(
    "pioneer_gazebo.adapters.learned_driver is now pioneer_gazebo.learning.training",
    DeprecationWarning,
    stacklevel=2,
)

if __name__ == "__main__":
    main()
