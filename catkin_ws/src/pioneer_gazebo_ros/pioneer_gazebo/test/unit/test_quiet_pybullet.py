"""The physics engine is imported silently, and the process can print as before."""

import subprocess
import sys


def test_importing_the_engine_prints_nothing():
    script = (
        "import sys, pioneer_gazebo.physics.bullet; print('out'); print('error', file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("out\n", "error\n")
