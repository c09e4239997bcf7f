"""Imports pybullet without the line that it prints to standard error."""

import os
import sys

sys.stderr.flush()
_error, _nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, 2)
try:
    import pybullet
finally:
    os.dup2(_error, 2)
    os.close(_error)
    os.close(_nowhere)

__all__ = ["pybullet"]
