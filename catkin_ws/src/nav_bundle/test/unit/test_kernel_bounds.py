"""The random messages again, with kernels that check every index: the compiled ones check none."""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
PROGRAM = """
import sys
import numba
from pioneer_kernels import declaration

def bounded(function=None, **_):
    make = numba.njit(boundscheck=True)
    return make if function is None else make(function)

# Kernels that are imported from here on are compiled at their first call.
declaration.jit = declaration.declare = bounded

import pytest
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def test_no_random_message_leads_a_kernel_out_of_its_arrays() -> None:
    command = [sys.executable, "-c", PROGRAM, str(FOLDER / "test_hostile_messages.py")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=240.0, check=False)
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-2000:]
