"""Former place of ``nav_bundle.planning.planner``."""

import warnings

from nav_bundle.planning.planner import *  # noqa: F403 - every name of the module, as before

warnings.warn(
    "nav_bundle.core.planner is now nav_bundle.planning.planner", DeprecationWarning, stacklevel=2
)
