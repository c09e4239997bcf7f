"""Imports without what a node does not need."""

import importlib
import sys
from types import ModuleType


def import_without_numpy(module: str) -> ModuleType:
    """Returns a module, imported without numpy; for nodes that do not compute.

    genpy imports numpy, if installed, only to report messages of wrong types, and works without it. This saves a node
    15 MB and 0.2 s of CPU time. numpy itself can still be imported afterwards.
    """
    if "numpy" not in sys.modules:
        sys.modules["numpy"] = None  # type: ignore[assignment] # makes its import raise ImportError
        try:
            import genpy  # noqa: F401
        finally:
            del sys.modules["numpy"]
    return importlib.import_module(module)
