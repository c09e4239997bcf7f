"""A launch file under ROS's roslaunch and under ours, which forks Python nodes: users see no difference."""

import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.proc import ProcessState, arguments, process_states
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves connections to nodes that have ended.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

PATIENCE = 60.0
NODES = {"screen", "file", "prefixed", "own", "foreign"}
LAUNCH = """
<launch>
  <group ns="robot">
    <remap from="cmd_vel" to="wanted"/>
    <env name="WORD" value="two words"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="screen" output="screen" args="a b" respawn="true"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="file" cwd="node"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="prefixed" launch-prefix="nice -n 1"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="own"><env name="PYTHONOPTIMIZE" value="1"/></node>
    <param name="robot_description" value="&lt;robot name='r'&gt;&lt;link name='l'/&gt;&lt;/robot&gt;"/>
    <node pkg="robot_state_publisher" type="robot_state_publisher" name="foreign"/>
  </group>
</launch>
"""


class Launched:
    """A running instance of the launch file."""

    def __init__(
        self, master: Master, group: ProcessGroup, folder: Path, command: list[str]
    ) -> None:
        self.master, self.group, self.log, self.folder = master, group, folder / "log", folder
        (folder / "nodes.launch").write_text(LAUNCH)
        self.pid = group.start(
            "roslaunch", [*command, str(folder / "nodes.launch")], master.environment, self.log
        )
        wait_until(
            lambda: {f"/robot/{name}" for name in NODES} <= self.nodes(), "all nodes", PATIENCE
        )

    def nodes(self) -> set[str]:
        self.group.check()
        return {
            node for part in self.master.system_state() for nodes in part.values() for node in nodes
        }

    def node(self, name: str) -> ProcessState:
        def found() -> list[ProcessState]:
            states = self.group.states().values()
            return [one for one in states if one.alive and f"__name:={name}" in arguments(one.pid)]

        return wait_until(found, f"the process of {name}", PATIENCE)[0]

    def seen(self) -> dict[str, Any]:
        """Returns everything that a user can see of the nodes, without numbers and folders that differ between runs."""
        run = str(self.master.get_param("/run_id"))
        connections = [
            {name: sorted(nodes) for name, nodes in part.items()}
            for part in self.master.system_state()
        ]
        facts: dict[str, Any] = {"nodes": self.nodes(), "connections": connections}
        for name in NODES:
            pid = self.node(name).pid
            process = Path(f"/proc/{pid}")
            environment = dict(
                part.split("=", 1) for part in (process / "environ").read_text().split("\0") if part
            )
            text = {
                "command": "\n".join(arguments(pid)),
                "name": (process / "comm").read_text(),
                "folder": os.readlink(process / "cwd"),
                "program": os.readlink(process / "exe"),
                "streams": "\n".join(
                    os.readlink(process / "fd" / str(number)) for number in (0, 1, 2)
                ),
                "environment": "".join(
                    f"{key}={environment[key]}\n" for key in sorted(environment) if _is_same(key)
                ),
            }
            facts[name] = {
                what: seen.replace(run, "RUN")
                .replace(str(self.master.home), "HOME")
                .replace(str(self.folder), "HERE")
                for what, seen in text.items()
            } | {"leads": os.getsid(pid) == os.getpgid(pid) == pid}
        return facts


def _is_same(variable: str) -> bool:
    return not variable.startswith(
        (
            "PIONEER_PROCESS_GROUP",
            "ROS_MASTER_URI",
            "_",
            "PYTEST",
            "OLDPWD",
            "PS1",
            "SHLVL",
            "ROS_LOG_FILENAME",
        )
    )


def start(folder: Path, command: list[str]) -> Iterator[Launched]:
    folder.mkdir()
    with Master() as master, ProcessGroup() as group:
        yield Launched(master, group, folder, command)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launched]:
    yield from start(tmp_path_factory.mktemp("original") / "run", ["roslaunch", "--no-summary"])


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launched]:
    command = ["rosrun", "rocon_launch", "roslaunch", "--no-summary"]
    yield from start(tmp_path_factory.mktemp("ours") / "run", command)


def test_nodes_look_the_same_in_proc_and_at_the_master(original: Launched, ours: Launched) -> None:
    expected, seen = original.seen(), ours.seen()
    for what in ("nodes", "connections"):
        assert seen[what] == expected[what]
    for name in NODES:
        for what, fact in expected[name].items():
            assert seen[name][what] == fact, f"{what} of {name}"


def test_python_nodes_without_prefix_and_early_variables_are_forked(ours: Launched) -> None:
    states = process_states()

    def parent(name: str) -> str:
        return arguments(states[ours.node(name).parent].pid)[1]

    assert {parent(name) for name in ("screen", "file")} == {"fork_server"}
    assert {os.path.basename(parent(name)) for name in ("prefixed", "own", "foreign")} == {
        "roslaunch"
    }


def test_roslaunch_reports_a_killed_node_and_starts_it_again(ours: Launched) -> None:
    first = ours.node("screen").pid
    os.kill(first, signal.SIGKILL)
    text = rf"\[robot/screen-\d+\] process has died \[pid {first}, exit code -9, cmd .*pioneer_pid_controller a b "
    wait_until(lambda: re.search(text, ours.log.read_text()), "the report", PATIENCE)
    wait_until(lambda: ours.node("screen").pid != first, "the next process", PATIENCE)
    assert arguments(ours.node("screen").parent)[1] == "fork_server"


def test_rosnode_info_and_kill_reach_a_forked_node(ours: Launched) -> None:
    def rosnode(*words: str) -> str:
        command = ["rosnode", *words]
        return subprocess.run(
            command, env=ours.master.environment, capture_output=True, text=True, check=True
        ).stdout

    pid = ours.node("file").pid
    info = rosnode("info", "/robot/file")
    assert f"Pid: {pid}\n" in info
    assert "/robot/wanted" in info
    rosnode("kill", "/robot/file")
    text = "[robot/file-2] process has finished cleanly"
    wait_until(lambda: text in ours.log.read_text(), "roslaunch's note", PATIENCE)


def test_interrupt_ends_all_nodes_and_the_server(ours: Launched) -> None:
    everything = [state.pid for state in ours.group.states().values() if state.alive]
    os.kill(ours.pid, signal.SIGINT)
    living = process_states()
    wait_until(
        lambda: not any(_lives(pid) for pid in everything if pid in living),
        "the end of all",
        PATIENCE,
    )
    assert "escalating" not in ours.log.read_text()


def _lives(pid: int) -> bool:
    state = process_states().get(pid)
    return state is not None and state.alive
