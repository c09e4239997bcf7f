"""Limits of the shell that are too low are named in one line, before anything starts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(("option", "limit"), [("-n", 64), ("-v", 1_000_000)])
def test_a_limit_that_is_too_low_is_named_in_one_line(
    tmp_path: Path, option: str, limit: int
) -> None:
    command = (
        f"ulimit {option} {limit}; exec {sys.executable} -m pioneer_demo fleet --log {tmp_path}/log"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        ["bash", "-c", command], env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("\n") == 1
    assert f"ulimit {option} is {limit}" in done.stderr
    assert not (tmp_path / "log").exists()
