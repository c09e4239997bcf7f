"""One run: a master, the simulator, robots that drive by their lasers, and one subscriber per topic.

Master, drivers and subscribers live in this process. The simulator is a separate process, and the only one that is
measured.
"""

import contextlib
import json
import os
import struct
import sys
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rospy
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool

from pioneer_bench.adapters.description import pioneer_urdf
from pioneer_bench.core import hall
from pioneer_bench.core.simulator import Rates
from pioneer_gazebo.world.sdf_text import sdf_from_world
from pioneer_harness.masters import Master
from pioneer_harness.proc import process_state
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

PATIENCE = 60.0
"""Time-out for anything to start [wall s]."""

WARM_UP = 2.0
"""Simulated time before the window [s]."""

OTHER_TOPICS = ("joint_states", "base_pose_ground_truth")


@dataclass(slots=True)
class Tally:
    """Counts of received messages; only one topic's thread writes each counter."""

    counts: dict[str, int] = field(default_factory=dict)
    time: float = 0.0
    arrived: threading.Condition = field(default_factory=threading.Condition)

    def counter(self, topic: str) -> Any:
        """Returns a callback that counts a topic's messages."""
        self.counts[topic] = 0

        def count(message: Any) -> None:
            del message
            self.counts[topic] += 1

        return count

    def note_clock(self, message: Clock) -> None:
        """Stores the simulated time."""
        with self.arrived:
            self.time = message.clock.to_sec()
            self.arrived.notify_all()

    def wait_for(self, moment: float) -> None:
        """Waits until the simulated time is ``moment`` [s]."""
        with self.arrived:
            while self.time < moment:
                if not self.arrived.wait(PATIENCE):
                    raise TimeoutError(f"the simulator stands at {self.time:.2f} s")


class Driver:
    """Drives one robot by its scans: ahead if there is room, else it turns to the freer side."""

    def __init__(self, name: str, tally: Tally) -> None:
        self._command = rospy.Publisher(f"/{name}/pioneer/cmd_vel", Twist, queue_size=1)
        self._count = tally.counter(f"/{name}/base_scan")
        rospy.Subscriber(
            f"/{name}/base_scan", rospy.AnyMsg, self._steer, queue_size=5, tcp_nodelay=True
        )

    def _steer(self, message: Any) -> None:
        self._count(message)
        data = message._buff
        (frame,) = struct.unpack_from("<I", data, 12)
        start = 16 + frame + 28
        (count,) = struct.unpack_from("<I", data, start)
        ranges = np.frombuffer(data, "<f4", count, start + 4)
        ahead = ranges[count * 3 // 8 : count * 5 // 8].min()
        right, left = (
            ranges[count // 4 : count // 2].min(),
            ranges[count // 2 : count * 3 // 4].min(),
        )
        command = Twist()
        command.linear.x = 0.5 if ahead > 0.9 else 0.0
        if ahead <= 0.9:
            command.angular.z = 1.0 if left > right else -1.0
        with contextlib.suppress(
            rospy.ROSException
        ):  # scans still arrive while the node shuts down
            self._command.publish(command)


def cpu_and_rss(pid: int) -> tuple[float, float]:
    """Returns a process's CPU time [s] and resident memory [MB]."""
    state = process_state(pid)
    if state is None:
        raise RuntimeError("the simulator has ended")
    return state.cpu, state.rss / 1e6


class Bench:
    """One run of ``robots`` on a running master; the simulator is the process ``pid``."""

    def __init__(self, robots: int, rates: Rates, pid: int) -> None:
        self._robots, self._rates, self._pid = robots, rates, pid
        self._tally = Tally()
        self._ready = threading.Event()
        rospy.Subscriber("/gazebo/ready", Bool, lambda message: self._ready.set(), queue_size=1)
        rospy.Subscriber("/clock", Clock, self._tally.note_clock, queue_size=5, tcp_nodelay=True)

    def run(self, seconds: float) -> dict[str, float]:
        """Spawns and drives the robots, and measures a window of simulated ``seconds``; returns fields of `Run`."""
        if not self._ready.wait(PATIENCE):
            raise TimeoutError("the simulator did not become ready")
        self._tally.wait_for(0.01)
        first_step, _ = cpu_and_rss(self._pid)
        names = self._spawn()
        for name in names:
            for topic in ("odom", *(OTHER_TOPICS if self._rates.other_rate else ())):
                full = f"/{name}/{topic}"
                rospy.Subscriber(
                    full, rospy.AnyMsg, self._tally.counter(full), queue_size=5, tcp_nodelay=True
                )
            Driver(name, self._tally)
        rospy.Subscriber(
            "/tf", rospy.AnyMsg, self._tally.counter("/tf"), queue_size=5, tcp_nodelay=True
        )
        wait_until(lambda: all(self._tally.counts.values()), "a message of every topic", PATIENCE)
        return {"first_step": first_step, **self._measured(seconds)}

    def _spawn(self) -> list[str]:
        rospy.wait_for_service("/gazebo/spawn_urdf_model", PATIENCE)
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", SpawnModel)
        rates, other = self._rates, self._rates.other_rate
        description = pioneer_urdf(
            laser_samples=rates.beams,
            laser_rate=rates.scan_rate,
            laser_max_range=8.0,
            odom_rate=rates.odometry_rate,
            **({"joint_rate": other, "ground_truth_rate": other} if other else {}),
        )
        names = []
        for number, (x, y) in enumerate(hall.starts()[: self._robots], start=1):
            name = f"pioneer{number}"
            rospy.set_param(f"/{name}/tf_prefix", name)
            answer = spawn(
                name, description, name, Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)), ""
            )
            if not answer.success:
                raise RuntimeError(answer.status_message)
            names.append(name)
        return names

    def _measured(self, seconds: float) -> dict[str, float]:
        tally = self._tally
        tally.wait_for(tally.time + WARM_UP)
        wall, (cpu, _), counts, start = self._now()
        tally.wait_for(start + seconds)
        end_wall, (end_cpu, rss), end_counts, end = self._now()
        arrived = {topic: end_counts[topic] - count for topic, count in counts.items()}
        simulated = end - start
        return {
            "robots": self._robots,
            "beams": self._rates.beams,
            "scan_rate": self._rates.scan_rate,
            "simulated": simulated,
            "wall": end_wall - wall,
            "cpu": end_cpu - cpu,
            "rss": rss,
            "scans": sum(count for topic, count in arrived.items() if topic.endswith("/base_scan")),
            # The window begins and ends between scans: one scan per robot may fall on either side.
            "scans_due": self._robots * int(simulated * self._rates.scan_rate - 1),
            "messages": sum(arrived.values()) / simulated,
        }

    def _now(self) -> tuple[float, tuple[float, float], dict[str, int], float]:
        """Returns wall time [s], CPU time and memory, the counts of messages, and simulated time [s]."""
        return time.monotonic(), cpu_and_rss(self._pid), dict(self._tally.counts), self._tally.time


def main(argv: list[str]) -> int:
    """Runs the setting given as JSON and prints the results as JSON."""
    setting = json.loads(argv[0])
    rates = Rates(**setting["rates"])
    with Master() as master, ProcessGroup() as group:
        os.environ.update(master.environment)
        world = master.home / "hall.world"
        world.write_text(sdf_from_world(hall.world(setting["seed"])))
        command = [
            sys.executable, "-c", "from pioneer_gazebo.node import main; raise SystemExit(main())",
            "__name:=gazebo", f"_world_name:={world}", f"_real_time_factor:={rates.real_time_factor}",
            f"_seed:={setting['seed']}", f"_clock_rate:={rates.clock_rate}",
        ]  # fmt: skip
        pid = group.start("simulator", command, master.environment, master.home / "simulator.log")
        rospy.init_node("pioneer_bench", disable_signals=True, disable_rostime=True)
        print(json.dumps(Bench(setting["robots"], rates, pid).run(setting["seconds"])), flush=True)
        rospy.signal_shutdown("measured")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
