"""Former place of ``nav_bundle.base.pose``."""

import warnings

from nav_bundle.base.pose import *  # noqa: F403 - every name of the module, as before

warnings.warn("nav_bundle.core.pose is now nav_bundle.base.pose", DeprecationWarning, stacklevel=2)
