"""The running simulator sends the same bytes for the same seed, world and commands, at any real-time factor."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import rospkg

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup

Recording = dict[str, list[str]]
"""The messages by topic, in hexadecimal digits."""

Record = Callable[..., Recording]

SECONDS = 4.0
RATES = {
    "base_scan": 10,
    "odom": 50,
    "base_pose_ground_truth": 20,
    "joint_states": 20,
    "clock": 100,
    "tf": 50,
}

# rosmaster runs in this process and leaves connections to exited nodes open.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

CLIENT = Path(__file__).with_name("scripted_client.py")


def description() -> str:
    xacro = Path(rospkg.RosPack().get_path("pioneer_description")) / "urdf" / "pioneer3dx.xacro"
    return subprocess.run(["xacro", str(xacro)], check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """Returns a function that runs the scripted client on its own simulator."""
    urdf = description()

    def run(factor: float, robots: str = "ab", seed: int = 3) -> Recording:
        folder = tmp_path_factory.mktemp("run")
        with Master() as master, ProcessGroup() as group:
            master.set_param("/robot_description", urdf)
            parameters = {
                "world_name": "small_world", "paused": True, "real_time_factor": factor, "seed": seed,
                "odometry_error": 0.01,
            }  # fmt: skip
            master.set_param("/gazebo", parameters)
            log = folder / "simulator.log"
            group.start(
                "simulator",
                ["rosrun", "pioneer_gazebo", "pioneer_gazebo_server", "__name:=gazebo"],
                master.environment,
                log,
            )
            output = folder / "messages"
            command = [
                sys.executable,
                str(CLIENT),
                robots,
                str(SECONDS),
                json.dumps(RATES),
                str(output),
            ]
            done = subprocess.run(
                command,
                env=master.environment,
                capture_output=True,
                text=True,
                timeout=120,
                check=False,
            )
            assert done.returncode == 0, done.stderr + log.read_text()
            return json.loads(output.read_text())

    return run


@pytest.fixture(scope="module")
def reference(record: Record) -> Recording:
    return record(1.0)


def within(recording: Recording) -> Recording:
    """Returns each topic's messages of the first `SECONDS`, as many as its rate requires."""
    due = {topic: int(SECONDS * RATES[topic.rpartition("/")[2]]) for topic in recording}
    # While paused, the simulator repeats the clock for each new subscriber: drop the duplicates.
    clock = sorted(set(recording["/clock"]))
    found = {
        topic: (clock if topic == "/clock" else messages)[: due[topic]]
        for topic, messages in recording.items()
    }
    assert {topic: len(messages) for topic, messages in found.items()} == due
    return found


def differing(a: Recording, b: Recording) -> dict[str, int]:
    """Returns the topics that differ, each with the index of its first differing message."""
    return {
        topic: next(
            number for number, (x, y) in enumerate(zip(a[topic], b[topic], strict=True)) if x != y
        )
        for topic in a
        if a[topic] != b[topic]
    }


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_the_same_bytes_come_at_any_real_time_factor(
    record: Record, reference: Recording, factor: float
) -> None:
    assert differing(within(reference), within(record(factor))) == {}


def test_another_robot_far_away_changes_nothing_for_the_others(
    record: Record, reference: Recording
) -> None:
    alone, together = within(reference), within(record(0.0, "abc"))
    own = [topic for topic in alone if topic != "/tf"]
    assert differing({t: alone[t] for t in own}, {t: together[t] for t in own}) == {}


def test_another_seed_gives_other_scans_and_odometry(record: Record, reference: Recording) -> None:
    other = differing(within(reference), within(record(0.0, seed=4)))
    assert {"/a/base_scan", "/b/base_scan", "/a/odom", "/b/odom"} <= set(other)
