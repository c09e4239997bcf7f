"""``git pull`` under a running fleet, in a copy of the checkout that is set up for it: takes some minutes."""

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from pioneer_fleet.registry import running_fleets
from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.soak

ROOT = Path(__file__).resolve().parents[5]
NOT_COPIED = (".git", ".setup", "build", "devel", "__pycache__")
SETUP, START_UP, DRIVE = 900.0, 240.0, 120.0
SOURCES = "catkin_ws/src"
KERNEL = f"{SOURCES}/pioneer_gazebo_ros/pioneer_gazebo/src/pioneer_gazebo/laser/laser_kernel.py"
MESSAGE = f"{SOURCES}/simple_navigation_goals/msg/WaypointQueue.msg"
ADDED = "zstandard==0.25.0"
"""A package that the section ``run`` does not have: it changes the environment of all commands."""
AUTHOR = ("-c", "user.name=pull", "-c", "user.email=pull@localhost")


class Clone:
    """A clone of a repository of the sources, to which ``push`` adds commits."""

    def __init__(self, folder):
        self.upstream, self.folder = folder / "upstream", folder / "clone"
        ignored = shutil.ignore_patterns(*NOT_COPIED)
        shutil.copytree(ROOT, self.upstream, symlinks=True, ignore=ignored)
        self._git(self.upstream, "init", "-q")
        self._commit("first")
        self._git(folder, "clone", "-q", self.upstream, self.folder)
        self.environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("ROS", "PYTHON", "PIONEER_", "CMAKE_PREFIX_PATH"))
        }
        # The environment's commands would hide Debian's.
        folders = self.environment["PATH"].split(os.pathsep)
        kept = [name for name in folders if not name.startswith(str(ROOT))]
        self.environment["PATH"] = os.pathsep.join(kept)

    def pull(self, changes):
        """Pulls a commit that changes files: the new texts by path."""
        for name, text in changes.items():
            (self.upstream / name).write_text(text)
        self._commit("changed")
        self._git(self.folder, "pull", "-q")

    def text(self, name):
        """Returns a file's text upstream."""
        return (self.upstream / name).read_text()

    def run(self, *argv, **variables):
        """Runs a command in the clone; returns its status and output."""
        done = subprocess.run(
            argv,
            cwd=self.folder,
            env={**self.environment, **variables},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=SETUP,
            check=False,
        )
        return done.returncode, done.stdout

    def _commit(self, words):
        self._git(self.upstream, "add", "-A", "-f")
        self._git(self.upstream, *AUTHOR, "commit", "-q", "-m", words)

    def _git(self, folder, *words):
        subprocess.run(("git", "-C", folder, *words), check=True, stdout=subprocess.DEVNULL)


@pytest.fixture
def clone(tmp_path):
    """Yields a clone that is set up."""
    made = Clone(tmp_path)
    assert made.run("./pioneer", "setup")[0] == 0
    return made


class Fleet:
    """A fleet of one robot that runs from a clone."""

    def __init__(self, clone):
        self.clone, self._output = clone, clone.folder.with_name("fleet.txt")
        words = ("./pioneer", "fleet", "--robots", "1", "--world", "small_world")
        with self._output.open("wb") as file:
            self.process = subprocess.Popen(
                words,
                cwd=clone.folder,
                env=clone.environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        wait_until(lambda: "ready in" in self.text(), "the fleet", START_UP)
        line = next(one for one in self.text().splitlines() if one.endswith("# pioneer1"))
        self._master = line.split()[1].partition("=")[2]

    def text(self):
        return self._output.read_text(errors="replace")

    def status(self):
        return next(one for one in running_fleets() if one["pid"] == self.process.pid)

    def drives(self, x, y):
        """Sends the robot to a place and waits until it is there; checks that nothing is wrong."""
        before = self.status()["robots"][0]["reached"]
        topic = ("/pioneer1/map_goal", "geometry_msgs/Twist", f"[{x}, {y}, 0.0]", "[0.0, 0.0, 0.0]")
        # From the fleet's own programs, which build nothing.
        setup = f"{self.clone.folder}/catkin_ws/devel/setup.bash"
        words = ("bash", "-c", f'. {setup}; exec rostopic pub -1 "$@"', "rostopic", *topic)
        status, text = self.clone.run(*words, ROS_MASTER_URI=self._master)
        assert status == 0, text
        wait_until(
            lambda: self.status()["robots"][0]["reached"] > before, "the robot's arrival", DRIVE
        )
        self.is_well()

    def is_well(self):
        status = self.status()
        assert status["faults"] == [], json.dumps(status)
        assert "died" not in self.text(), self.text()

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.process.wait(60.0)


@pytest.fixture
def fleet(clone):
    """Yields a fleet that runs; ends it."""
    made = Fleet(clone)
    yield made
    made.end()


def test_a_pull_does_not_disturb_a_running_fleet_and_the_next_command_says_what_to_do(clone, fleet):
    """Built in place: a kernel and a message; refused while the fleet runs: another Python environment."""
    fleet.drives(-3.5, 3.5)
    kernel, message = clone.text(KERNEL), clone.text(MESSAGE)
    clone.pull({KERNEL: f"{kernel}# Changed.\n", MESSAGE: f"{message}string added\n"})
    fleet.drives(-4.5, 3.5)
    status, text = clone.run("./pioneer", "run", "true")
    assert status == 0, text
    assert "Building the workspace: done" in text
    said = f"The fleet of process {fleet.process.pid} has the former sources until it is started"
    assert said in text
    fleet.drives(-3.5, 3.5)
    lists = clone.text("requirements.txt")
    clone.pull({"requirements.txt": lists.replace("## run\n", f"## run\n{ADDED}\n", 1)})
    fleet.drives(-4.5, 3.5)
    status, text = clone.run("./pioneer", "run", "true")
    assert status == 1, text
    assert f"a fleet runs from it (process {fleet.process.pid}): end it with Ctrl-C" in text
    assert clone.run("./pioneer", "status")[0] == 0
    fleet.drives(-3.5, 3.5)
    assert fleet.end() == 130
    status, text = clone.run("./pioneer", "run", "true")
    assert status == 0, text
    assert "Installing Python packages" in text
