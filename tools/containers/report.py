"""The state of each computer: runs pioneer_fleet's ``report`` in every container in parallel."""

import json
import subprocess
import threading
from collections.abc import Callable, Sequence
from typing import Any

from containers.engine import Computer

_WORKSPACE = "/opt/pioneer/catkin_ws"
REPORT = (f"{_WORKSPACE}/src/pioneer_node/scripts/forked", f"{_WORKSPACE}/devel/lib/pioneer_fleet/report")
"""The command without the arguments of ``report``. As a fork of the computer's process it need not import rospy."""


def follow(
    asked: Sequence[tuple[Computer, Sequence[str]]], heard: Callable[[Computer, dict[str, Any]], None]
) -> dict[str, bool]:
    """Runs the report on computers in parallel, each with its arguments, until all end; ``heard`` gets each line.

    Returns:
        By computer, whether it reached the requested state.
    """
    lock, results = threading.Lock(), dict[str, bool]()

    def run(computer: Computer, arguments: Sequence[str]) -> None:
        command = [*computer.docker, "exec", computer.container, *REPORT, "--robot", computer.robot, *arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                with lock:
                    heard(computer, json.loads(line))
            problem = process.stderr.read().strip()
        if process.returncode > 1 or (process.returncode and problem):
            with lock:
                heard(
                    computer, {"lacks": (problem.splitlines() or ["the container has ended"])[-1], "stage": "starting"}
                )
        results[computer.name] = process.returncode == 0

    threads = [threading.Thread(target=run, args=one) for one in asked]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results
