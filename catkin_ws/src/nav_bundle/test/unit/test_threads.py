"""Linear algebra starts no threads: they would spin longer than the work takes."""

import os
import subprocess
import sys


def test_a_product_of_matrices_runs_in_one_thread() -> None:
    program = (
        "import nav_bundle.core.localisation, numpy, os;"
        "numpy.ones((300, 300)) @ numpy.ones((300, 300));"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1"
