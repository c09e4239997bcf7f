"""Former place of ``import_without_numpy``, now in `pioneer_node.adapters.light_import`."""

import warnings

from pioneer_node.adapters.light_import import import_without_numpy

__all__ = ["import_without_numpy"]

warnings.warn(
    "pioneer_node.nodes.patch is now pioneer_node.adapters.light_import and pioneer_launch",
    DeprecationWarning,
    stacklevel=2,
)
