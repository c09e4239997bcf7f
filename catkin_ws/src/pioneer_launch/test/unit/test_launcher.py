"""The launcher with roslaunch's own process monitor, in a process of its own."""

import subprocess
import sys
from pathlib import Path

DRIVER = """
import os, signal, sys
from pioneer_launch.fork_server import start_server
from pioneer_launch.forked_program import Program
from pioneer_launch.launcher import fork_nodes
server = start_server()
if isinstance(server, Program):
    server.run()
    sys.exit()
fork_nodes(server)

import roslaunch.pmon
from roslaunch.pmon import FatalProcessLaunch
from roslaunch.nodeprocess import LocalProcess

folder = sys.argv[1]
monitor = roslaunch.pmon.start_process_monitor()
arguments = ["/bin/sh", "-c", f"touch {folder}/started"]
node = LocalProcess("run", "package", "node", arguments, dict(os.environ), log_output=False)
monitor.register(node)
os.kill(os.getpid(), signal.SIGINT)
try:
    node.start()
except FatalProcessLaunch as error:
    print(error)
print(node.popen)
"""


def test_roslaunch_that_is_interrupted_before_it_starts_a_node_does_not_start_it(
    tmp_path: Path,
) -> None:
    driver = tmp_path / "driver.py"
    driver.write_text(DRIVER)
    done = subprocess.run(
        [sys.executable, str(driver), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    assert "roslaunch is ending" in done.stdout
    assert done.stdout.rstrip().endswith("None")
    assert not (tmp_path / "started").exists()
