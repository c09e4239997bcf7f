"""pybullet, without the line that its import prints."""

import ctypes
import os
import sys

if "pybullet" in sys.modules:
    import pybullet
else:
    sys.stdout.flush()
    _libc, _output, _nowhere = ctypes.CDLL(None), os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(_nowhere, 1)
    try:
        import pybullet
    finally:
        _libc.fflush(None)  # where the output is no terminal, the line is still in C's buffer
        os.dup2(_output, 1)
        os.close(_output)
        os.close(_nowhere)

__all__ = ["pybullet"]
