"""Kills ``setup``, ``fleet``, ``experiment`` and ``up`` at random moments with SIGKILL; the next call must work.

``./pioneer test --soak`` runs it, among others. Each trial has a seed of its own, which its name shows:
``PIONEER_KILLS`` sets the number of trials of each command (50), ``PIONEER_SOAK_SEED`` the first one's seed.
``PIONEER_KILLS_COPY`` names a folder for the copy of the checkout that is set up, which is kept.
"""

import csv
import hashlib
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_demo.console.output_folder import FolderLock
from pioneer_fleet.registry import running_fleets
from pioneer_harness.proc import arguments, has_variable, process_states
from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.soak

ROOT = Path(__file__).resolve().parents[5]
FIRST_SEED = int(os.environ.get("PIONEER_SOAK_SEED", "1"))
TRIALS = int(os.environ.get("PIONEER_KILLS", "50"))
SEEDS = range(FIRST_SEED, FIRST_SEED + TRIALS)
MARK = "PIONEER_KILLS_TEST"
HOW = ("main", "group", "all")
"""What a kill ends: the command's main process, its process group as a terminal does, or all that it has started."""
ENDED = 60.0
"""Time limit for the end of what a killed command has started [s]."""
START_UP = 240.0
SETUP = 600.0
STUDY = 240.0
GOAL = 0.5
"""Largest error of a robot's estimated pose [m]."""


def say(text):
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


class Call:
    """A command in its own session; an environment variable marks all processes that it has started."""

    def __init__(self, folder, argv, output, environment):
        self.output = output
        self._mark = str(output)
        with output.open("wb") as file:
            self.process = subprocess.Popen(
                list(map(str, argv)),
                cwd=folder,
                env={**environment, MARK: self._mark},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def text(self):
        return self.output.read_text(errors="replace")

    def processes(self):
        """Returns the command line of each live process that carries the mark, by PID."""
        return {
            pid: " ".join(arguments(pid))
            for pid, state in process_states().items()
            if state.alive and has_variable(pid, MARK, self._mark)
        }

    def kill_after(self, seconds, how):
        """Kills the command after ``seconds``; returns whether it was still running."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self._kill(how)
            self.process.wait()
            return True
        return False

    def _kill(self, how):
        if how == "main":
            self.process.kill()
        else:
            os.killpg(self.process.pid, signal.SIGKILL)
        while how == "all" and (left := self.processes()):
            for pid in left:
                send(pid)

    def status(self, timeout):
        """Waits for the command's end; returns its exit status."""
        return self.process.wait(timeout)

    def await_words(self, words, timeout):
        def printed():
            assert self.process.poll() is None, f"it ended too early:\n{self.text()}"
            return words in self.text()

        wait_until(printed, f"'{words}' in {self.output}", timeout)

    def await_its_processes_end(self):
        """Waits until nothing is left of the command."""
        try:
            wait_until(lambda: not self.processes(), "the end of its processes", ENDED)
        except Exception:
            say("\n".join(f"left of {self.output}: {line}" for line in self.processes().values()))
            raise

    def end(self):
        while left := self.processes():
            for pid in left:
                send(pid)
        self.process.wait()


def send(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


@pytest.fixture
def call(tmp_path):
    """Yields a function that starts commands; ends what is left of them."""
    calls = []

    def begin(folder, *argv, environment=None):
        output = tmp_path / f"call{len(calls)}.txt"
        own = {**os.environ, "PYTHONPATH": python_path()} if environment is None else environment
        calls.append(Call(folder, argv, output, own))
        return calls[-1]

    yield begin
    for one in calls:
        one.end()


def python_path():
    built = [path for path in sys.path if "/devel/" in path]
    return os.pathsep.join([*built, *filter(None, sys.path)])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_fleet_starts_after_one_that_was_killed(call, tmp_path, seed):
    """With the same folder, at once: all robots are there and localised, and the killed one's processes end."""
    draw = random.Random(seed)
    robots = draw.choice((1, 2))
    how = draw.choice(HOW)
    moment = draw.uniform(0.0, draw.choice((5.0, 25.0)))
    words = (sys.executable, "-m", "pioneer_demo", "fleet", "--log", "log")
    words += ("--robots", robots, "--world", "small_world")
    first = call(tmp_path, *words)
    assert first.kill_after(moment, how), first.text()
    second = call(tmp_path, *words)
    second.await_words("ready in small_world", START_UP)
    started = second.text()
    first.await_its_processes_end()
    wait_until(lambda: well(second), f"{robots} localised robots: {fleet_status(second)}", 30.0)
    say(f"seed {seed}: {how} killed after {moment:.1f} s, {robots} robots; {ready_line(started)}")
    assert len(fleet_status(second)["robots"]) == robots
    assert "has died" not in second.text(), second.text()
    second.process.send_signal(signal.SIGINT)
    assert second.status(30.0) == 130, second.text()
    assert second.processes() == {}


def fleet_status(call):
    pid = call.process.pid
    return next((one for one in running_fleets() if one["pid"] == pid), None)


def well(call):
    status = fleet_status(call)
    if status is None or status["faults"]:
        return False
    errors = [robot["localisation_error"] for robot in status["robots"]]
    return all(error is not None and error < GOAL for error in errors)


def ready_line(text):
    return next(line for line in text.splitlines() if "ready in" in line)


RUNS = 3
STAND_IN = Path(__file__).with_name("study_program.py")
SCENARIO = """\
world: small_world
robots: [{pose: {x: -2.0, y: -2.0, a: 0.0}, goals: [[-1.0, -2.0]]}]
limit: 60
"""


@pytest.mark.parametrize("seed", SEEDS)
def test_an_experiment_that_was_killed_resumes_with_right_results(call, tmp_path, seed):
    """Nearly all trials take a program that stands in for a scenario's run; each tenth starts fleets."""
    draw = random.Random(seed)
    real = seed % 10 == 0
    write_study(tmp_path, real)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    own = {**os.environ, "PYTHONPATH": python_path(), "TMPDIR": str(temporary)}
    words = (sys.executable, "-m", "pioneer_demo", "experiment", "study.yaml", "--output", "out")
    words += ("--jobs", 1 if real else draw.choice((1, 2)))
    kills = []
    for _ in range(draw.choice((1, 1, 2))):
        how = draw.choice(HOW)
        moment = draw.uniform(0.0, draw.choice((5.0, 60.0 if real else 25.0)))
        running = call(tmp_path, *words, environment=own)
        if running.kill_after(moment, how):
            kills.append((running, f"{how} after {moment:.1f} s"))
        else:
            assert running.process.returncode == 0, running.text()
    kept = {path: path.read_bytes() for path in (tmp_path / "out" / "runs").glob("*.json")}
    last = call(tmp_path, *words, environment=own)
    assert last.status(STUDY) == 0, last.text()
    for running, _ in kills:
        running.await_its_processes_end()
    last.await_its_processes_end()
    say(f"seed {seed}: {'; '.join(how for _, how in kills) or 'not killed'}; {len(kept)} kept")
    assert {path: path.read_bytes() for path in kept} == kept
    check_results(tmp_path, real)
    left = [str(path) for path in (tmp_path / "out").rglob("*") if is_litter(path)]
    # The folder of the fleets' registry stays, without any fleet.
    left += [
        str(path)
        for path in temporary.iterdir()
        if not path.name.startswith("pioneer-fleets-") or any(path.iterdir())
    ]
    assert left == []


def write_study(folder, real):
    journal = folder / "journal"
    journal.write_text("")
    if real:
        (folder / "s.yaml").write_text(SCENARIO)
        (folder / "study.yaml").write_text("scenario: s.yaml\nruns: 2\n")
        return
    (folder / "s.yaml").write_text(f"about: {journal}\nworld: small_world\nwaypoints: 1\n")
    program = shlex.join([sys.executable, str(STAND_IN)])
    variants = "variants:\n  near: {}\n  far: {waypoints: 2}\n"
    (folder / "study.yaml").write_text(
        f"scenario: s.yaml\nruns: {RUNS}\nprogram: {program}\n{variants}"
    )


def check_results(folder, real):
    """Checks that the table has each run once, with its figures."""
    out = folder / "out"
    rows = list(csv.DictReader((out / "runs.csv").read_text().splitlines()))
    if real:
        assert [(row["seed"], row["success"]) for row in rows] == [("1", "True"), ("2", "True")]
    else:
        expected = [
            (variant, str(seed), f"{10.0 * slow + seed}")
            for variant, slow in (("near", 1), ("far", 2))
            for seed in range(1, RUNS + 1)
        ]
        assert sorted((row["variant"], row["seed"], row["seconds"]) for row in rows) == sorted(
            expected
        )
    json.loads((out / "summary.json").read_text())
    assert "</html>" in (out / "report.html").read_text()
    with FolderLock(out):
        pass


def is_litter(path):
    return path.name.startswith("scratch-") or path.suffix == ".part"


NOT_COPIED = (".git", ".setup", "build", "devel", "__pycache__")
PACKAGES = ("pioneer_gazebo", "pioneer_kernels", "pioneer_msgs", "pioneer_node")
"""The copy's packages: messages, a kernel and programs, but not minutes of building."""
BUILDING = (
    "packages", "messages", "kernels", "all", "environment", "section", "section and all", "everything",
)  # fmt: skip
"""What is left to do for the set-up that is killed."""
COMPILING = ("kernels", "everything")
"""Those for which kernels are compiled; the others take them from the user's cache."""
SECTION = "web record"
SET_UP_SECTION = ("./pioneer", "run", "true", "fleet_page")
"""A command that needs the packages of ``SECTION``."""
CHECK_PACKAGES = """
import importlib.metadata as metadata, pathlib, re, sys
removed = re.compile(r"^(pybullet_(data|envs|examples|robots|utils)/|.*/bin/xacro$)")
folder = next(pathlib.Path(sys.prefix).glob("lib/python3.*/site-packages"))
found = {}
for package in metadata.distributions(path=[str(folder)]):
    found[package.metadata["Name"].lower()] = package.version
    assert package.files, f"{package.name} has no list of its files"
    for file in package.files:
        path = pathlib.Path(package.locate_file(file))
        if not removed.match(str(file)) and not str(file).endswith(".pyc"):
            assert path.is_file(), f"{path} is missing"
            assert file.size in (None, path.stat().st_size), f"{path} is not whole"
for word in sys.argv[1:]:
    name, _, version = word.partition("==")
    assert found.get(name.lower()) == version, f"{name}: {found.get(name.lower())}, not {version}"
"""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the checkout that is set up, with the state of its workspace."""
    given = os.environ.get("PIONEER_KILLS_COPY", "")
    folder = Path(given) if given else tmp_path_factory.mktemp("copy")
    if not (folder / "pioneer").exists():
        ignored = shutil.ignore_patterns(*NOT_COPIED)
        shutil.copytree(ROOT, folder, symlinks=True, ignore=ignored, dirs_exist_ok=True)
        for package in list((folder / "catkin_ws" / "src").rglob("package.xml")):
            if package.parent.name not in PACKAGES:
                shutil.rmtree(package.parent)
    return Checkout(folder)


class Checkout:
    """A checkout of its own."""

    def __init__(self, folder):
        self.folder = folder
        self._kernels = folder / "cache" / "pioneer" / "kernels"
        self.environment = {**outside_the_workspace(), "XDG_CACHE_HOME": str(folder / "cache")}
        self.run("./pioneer", "setup")
        self.run(*SET_UP_SECTION)
        self.built = self._built()

    def run(self, *argv):
        """Runs a command; returns what it prints."""
        done = subprocess.run(
            argv, cwd=self.folder, env=self.environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def prepare(self, kind):
        """Undoes a part of the set-up."""
        setup = self.folder / ".setup"
        sources = self.folder / "catkin_ws" / "src"
        touched = {"packages": "package.xml", "messages": "*.msg", "kernels": "*_kernel.py"}
        for path in sources.rglob(touched.get(kind, "none")):
            path.touch()
        if kind in COMPILING:
            shutil.rmtree(self._kernels)
        if kind.endswith(("all", "everything")):
            shutil.rmtree(self.folder / "catkin_ws" / "build")
            shutil.rmtree(self.folder / "catkin_ws" / "devel")
        if kind == "everything":
            shutil.rmtree(setup)
        elif kind == "environment":
            (setup / "venv" / "sections" / "run").unlink()
        elif kind.startswith("section"):
            pip = (setup / "venv" / "bin" / "pip", "uninstall", "-q", "-y")
            self.run(*pip, *(name.partition("==")[0] for name in self._requirements(SECTION)))
            for name in SECTION.split():
                (setup / "venv" / "sections" / name).unlink()

    def check(self):
        """Checks that nothing is left to do, and that everything is there and whole."""
        # An environment that was being made again may have lost a section, which its commands install.
        self.run(*SET_UP_SECTION)
        assert self.run("./pioneer", "setup") == ""
        assert self.run(*SET_UP_SECTION) == ""
        python = self.folder / ".setup" / "venv" / "bin" / "python3"
        self.run(python, "-c", CHECK_PACKAGES, *self._requirements("run " + SECTION))
        libraries = [path for path in self._files() if path.suffix == ".so"]
        self.run(
            python, "-c", "import ctypes, sys; list(map(ctypes.CDLL, sys.argv[1:]))", *libraries
        )
        kept = {checksum(path) for path in self._kernels.glob("*.so")}
        assert [path for path in libraries if checksum(path) not in kept] == []
        built = self._built()
        differing = sorted(
            path for path in {*built, *self.built} if built.get(path) != self.built.get(path)
        )
        assert differing == []

    def _requirements(self, sections):
        script = f"root=$PWD; . tools/setup.bash; requirements_of {sections}"
        lines = self.run("bash", "-c", script).splitlines()
        newer = sys.version_info >= (3, 12)
        return [
            line.partition(";")[0]
            for line in lines
            if ";" not in line or ('>= "3.12"' in line) == newer
        ]

    def _files(self):
        """Returns the files that the build has made for nodes to read."""
        folder = self.folder / "catkin_ws" / "devel"
        return [path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"]

    def _built(self):
        """Returns a checksum of each of these files; none of a compiled kernel's, which differs each time."""
        return {str(path): "" if path.suffix == ".so" else checksum(path) for path in self._files()}


def checksum(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def outside_the_workspace():
    """Returns this process's environment without what the workspace of this test has added."""
    added = (
        "ROS_",
        "CMAKE_PREFIX_PATH",
        "PYTHON",
        "LD_LIBRARY_PATH",
        "PKG_CONFIG_PATH",
        "ROSLISP",
        "PIONEER_",
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith(added)}
    folders = environment["PATH"].split(os.pathsep)
    environment["PATH"] = os.pathsep.join(
        folder for folder in folders if not folder.startswith(str(ROOT))
    )
    return environment


@pytest.mark.parametrize("seed", SEEDS)
def test_a_set_up_that_was_killed_is_completed_by_the_next_call(call, checkout, seed):
    """All packages have all their files, and the build has made the same files as without a kill."""
    draw = random.Random(seed)
    kind = draw.choice(BUILDING)
    how = draw.choice(HOW)
    moment = draw.uniform(0.0, draw.choice((2.0, 10.0, 40.0)))
    words = SET_UP_SECTION if kind.startswith("section") else ("./pioneer", "setup")
    checkout.prepare(kind)
    killed = call(checkout.folder, *words, environment=checkout.environment)
    while not killed.kill_after(moment, how):
        assert killed.process.returncode == 0, killed.text()
        moment /= 2.0
        checkout.prepare(kind)
        killed = call(checkout.folder, *words, environment=checkout.environment)
    following = call(checkout.folder, *words, environment=checkout.environment)
    assert following.status(SETUP) == 0, following.text()
    killed.await_its_processes_end()
    say(f"seed {seed}: {kind}, {how} killed after {moment:.1f} s; {following.text().strip()}")
    checkout.check()


PROJECT = "pioneer-kills"
SUBNET = "192.168.214"
CONTAINERS = 120.0
"""Time limit for the end of a fleet of containers [s]."""
LABEL = f"label=com.docker.compose.project={PROJECT}"


def docker(*words):
    done = subprocess.run(["docker", *words], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.fixture
def engine():
    """Yields the environment of a fleet of containers, which is removed before and after."""
    if (
        shutil.which("docker") is None
        or subprocess.run(["docker", "version"], capture_output=True).returncode
    ):
        pytest.skip("no Docker engine answers")
    environment = {
        **outside_the_workspace(),
        "PIONEER_PROJECT": PROJECT,
        "PIONEER_SUBNET": SUBNET,
        **({"PIONEER_IMAGE": image} if (image := os.environ.get("PIONEER_IMAGE")) else {}),
    }
    remove_containers()
    yield environment
    remove_containers()


def remove_containers():
    if found := docker("ps", "-aq", "--filter", LABEL):
        docker("rm", "-f", "-v", *found)
    if found := docker("network", "ls", "-q", "--filter", LABEL):
        docker("network", "rm", *found)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_fleet_of_containers_is_brought_up_and_down_after_an_up_that_was_killed(
    call, engine, seed
):
    """The killed call starts the fleet, or adds a robot to it."""
    draw = random.Random(seed)
    how = draw.choice(HOW)
    joins = draw.random() < 0.25
    moment = draw.uniform(0.0, draw.choice((4.0, 30.0)))
    words = (ROOT / "pioneer", "up", "--world", "small_world", "--waypoints", 1, "--robots")
    robots = 2 if joins else 1
    if joins:
        first = call(ROOT, *words, 1, environment=engine)
        assert first.status(START_UP) == 0, first.text()
    killed = call(ROOT, *words, robots, environment=engine)
    done = not killed.kill_after(moment, how)
    following = call(ROOT, *words, robots, environment=engine)
    assert following.status(START_UP) == 0, killed.text() + following.text()
    killed.await_its_processes_end()
    say(
        f"seed {seed}: {how} {'done' if done else 'killed'} after {moment:.1f} s,"
        f" {robots} robots; {following.text().splitlines()[-1]}"
    )
    assert len(docker("ps", "-q", "--filter", LABEL)) == 1 + robots
    assert len(docker("ps", "-aq", "--filter", LABEL)) == 1 + robots
    ask = ("rosservice", "call", "/gazebo/get_world_properties")
    world = call(ROOT, ROOT / "pioneer", "exec", "aadiworkstation", *ask, environment=engine)
    assert world.status(60.0) == 0, world.text()
    for number in range(1, robots + 1):
        assert f"pioneer{number}" in world.text()
    down = call(ROOT, ROOT / "pioneer", "down", environment=engine)
    assert down.status(CONTAINERS) == 0, down.text()
    for kind in (("ps", "-a"), ("network", "ls"), ("volume", "ls")):
        assert docker(*kind, "-q", "--filter", LABEL) == []
