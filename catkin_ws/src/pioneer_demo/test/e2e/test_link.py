"""Link faults, measured on real packets."""

import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_demo.processes.network import NetworkError, apart


def test_packets_between_a_robot_and_others_are_late_and_lost_as_its_link_says():
    trial = Path(__file__).with_name("link_trial.py")
    try:
        prefix = apart()
    except NetworkError as error:
        pytest.skip(str(error))
    done = subprocess.run(
        [*prefix, sys.executable, str(trial)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0,
    )
    assert done.returncode == 0, done.stderr
    (plain, robots, lossy, cut) = (
        tuple(map(float, line.split())) for line in done.stdout.splitlines()
    )
    assert plain[0] == robots[0] == 0.0
    assert plain[1] < 0.1
    assert 4 <= lossy[0] <= 26, "of 40 there and back, 36 % are lost"
    assert lossy[1] >= 0.1
    assert cut[0] == 40.0
