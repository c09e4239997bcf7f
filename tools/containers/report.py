"""The state of each computer: ``report`` of package pioneer_fleet, run in every container at once."""

import json
import subprocess
import threading
from collections.abc import Callable, Sequence
from typing import Any

from containers.engine import Computer

_WORKSPACE = "/opt/pioneer/catkin_ws"
REPORT = (f"{_WORKSPACE}/src/pioneer_node/scripts/forked", f"{_WORKSPACE}/devel/lib/pioneer_fleet/report")
"""The command, to which the arguments of ``report`` are added. A fork of what the computer runs imports no rospy."""


def follow(
    asked: Sequence[tuple[Computer, Sequence[str]]], heard: Callable[[Computer, dict[str, Any]], None]
) -> dict[str, bool]:
    """Runs the report on computers, each with its arguments, until all end; ``heard`` gets each line in turn.

    Returns:
        By computer, whether it came as far as was asked.
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
