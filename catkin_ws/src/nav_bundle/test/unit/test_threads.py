"""Linear algebra starts no threads: they would spin longer than the work takes."""

import os
import subprocess
import sys
from pathlib import Path

from nav_bundle import _alignment


def test_a_product_of_matrices_runs_in_one_thread() -> None:
    program = (
        "import nav_bundle.localisation.localisation, numpy, os;"
        "numpy.ones((300, 300)) @ numpy.ones((300, 300));"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {
        name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")
    }
    environment["PYTHONPATH"] = str(Path(_alignment.__file__).parents[1])
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout.strip() == "1"
