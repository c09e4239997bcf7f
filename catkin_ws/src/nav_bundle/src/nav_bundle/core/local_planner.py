"""Former place of ``nav_bundle.control.local_planner``."""

import warnings

from nav_bundle.control.local_planner import *  # noqa: F403 - every name of the module, as before

warnings.warn(
    "nav_bundle.core.local_planner is now nav_bundle.control.local_planner",
    DeprecationWarning,
    stacklevel=2,
)
