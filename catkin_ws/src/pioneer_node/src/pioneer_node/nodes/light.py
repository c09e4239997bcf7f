"""Importing this before anything else of ROS spares a node that computes nothing 15 MB and 0.2 s of processor time.

For nothing but complaints about messages of wrong types, genpy imports numpy where there is one, and does without where
there is none. numpy itself can be imported afterwards as ever.
"""

import sys

if "numpy" not in sys.modules:
    sys.modules["numpy"] = None  # type: ignore[assignment] # for which an import raises ImportError
    try:
        import genpy  # noqa: F401
    finally:
        del sys.modules["numpy"]
