"""Runs a scenario's program once its robot is set up: ``python3 -m pioneer_demo.processes.program WORD…``."""

import os
import sys

import rosgraph

from pioneer_harness.masters import is_running
from pioneer_harness.wait import wait_until

_START = 300.0


def _is_set_up(uri: str) -> bool:
    """Returns whether the robot's ROS master runs and has ``/use_sim_time``, which nodes read only once."""
    return is_running(uri) and rosgraph.Master("/program").hasParam("/use_sim_time")


if __name__ == "__main__":
    own = os.environ["ROS_MASTER_URI"]
    wait_until(lambda: _is_set_up(own), f"/use_sim_time on {own}", _START)
    os.execvp(sys.argv[1], sys.argv[1:])
