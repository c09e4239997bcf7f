"""Measures a robot's link without faults, with loss and delay, and cut. Run it in a network namespace of its own."""

import pathlib
import subprocess
import sys

from pioneer_demo.processes.network import Networks
from pioneer_demo.scenario.link import Condition

ECHO = str(pathlib.Path(__file__).with_name("udp_echo.py"))
subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
networks = Networks(["one", "two"], 6380)
server = subprocess.Popen(networks.placed("one", [sys.executable, ECHO]), stdout=subprocess.PIPE)
assert server.stdout is not None
server.stdout.readline()
for robot, condition in [
    ("", {}),
    ("two", {}),
    ("", {"loss": 0.2, "delay": 0.05}),
    ("", {"loss": 1.0}),
]:
    networks.set("one", Condition(**condition))
    subprocess.run(
        networks.placed(robot, [sys.executable, ECHO, networks.environment("one")["ROS_IP"]]),
        check=True,
    )
server.kill()
server.wait()
networks.close()
