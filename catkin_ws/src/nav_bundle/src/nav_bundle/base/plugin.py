"""Classes of any Python package, named in parameters as ``package.module.Class``."""

import importlib
from typing import Any

from nav_bundle.base.error import NavigationError


class PluginError(NavigationError):
    """A class that parameters name cannot be loaded; the message has the name and the reason."""


def is_class_name(text: str) -> bool:
    """Returns whether ``text`` has the form ``package.module.Class``."""
    parts = text.split(".")
    return len(parts) > 1 and all(part.isidentifier() for part in parts)


def class_named(text: str) -> type[Any]:
    """Returns the class ``package.module.Class``.

    Raises:
        PluginError: there is no such module or class, or the module fails when it is imported.
    """
    module_name, _, name = text.rpartition(".")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        raise PluginError(
            f"{text} cannot be loaded: importing {module_name} fails with {type(error).__name__}: {error}"
        ) from error
    found = getattr(module, name, None)
    if not isinstance(found, type):
        raise PluginError(f"{text} cannot be loaded: {module_name} has no class {name}")
    return found
