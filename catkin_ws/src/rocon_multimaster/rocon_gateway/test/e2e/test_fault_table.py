"""Measures gateways on bad networks: what is lost, how fast a fault is noticed, and how fast traffic recovers.

Takes about twelve minutes; its rows are the table "Bad networks" in `docs/performance.md`. A robot on another machine
publishes small messages (64 B at 20 Hz) and large ones (20 kB at 5 Hz), which a base station here receives.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from gateway_msgs import srv
from measure import checked

from pioneer_harness.masters import MasterProcess
from pioneer_harness.wait import START, WaitError, wait_until
from pioneer_harness.wire import Condition, WiredMachine, WireError

pytestmark = [
    pytest.mark.soak,
    # rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
    pytest.mark.filterwarnings(
        "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
    ),
]

TOPICS = {"/small": (64, 20), "/big": (20_000, 5)}
"""Size [bytes] and rate [Hz] of the messages."""

RECOVERY = 40.0
"""Within which messages come again after a fault [s]."""

AVAILABILITY_PERIOD = 0.5
"""Time between two questions whether the robot's gateway is available [s]."""

CUT = Condition(cut=True)
FINE = Condition()


@dataclass
class Fault:
    """A fault of the network, and how long it lasts [s]."""

    name: str
    seconds: float
    out: Condition
    back: Condition | None = None


FAULTS = [
    Fault("5 % loss", 20, Condition(loss=0.05)),
    Fault("10 % loss", 20, Condition(loss=0.1)),
    Fault("20 % loss", 20, Condition(loss=0.2)),
    Fault("30 % loss", 20, Condition(loss=0.3)),
    Fault("delay 200 ms each way", 15, Condition(delay=0.2)),
    Fault("reordering (delay 0 to 50 ms)", 15, Condition(jitter=0.05)),
    Fault("1 Mbit/s", 15, Condition(rate=1e6)),
    Fault("cut for 5 s", 5, CUT),
    Fault("cut for 30 s", 30, CUT),
    Fault("cut for 120 s", 120, CUT),
    Fault("robot to base cut for 30 s", 30, CUT, FINE),
    Fault("base to robot cut for 30 s", 30, FINE, CUT),
    Fault("MTU 1000", 40, Condition(mtu=1000)),
    Fault("MTU 576", 40, Condition(mtu=576)),
]


@pytest.fixture(scope="module")
def wire() -> Iterator[WiredMachine]:
    try:
        made = WiredMachine()
    except WireError as error:
        pytest.skip(f"bad networks are not measured here: {error}")
    yield made
    made.close()


@pytest.fixture(scope="module")
def far(wire, shared_fleet):
    """A base station here and a robot on the other machine, whose topics are flipped to the base."""
    fleet = shared_fleet
    fleet.hub_uri = f"http://{wire.here}:{fleet.hub_port}"
    fleet.start_hub(insecure=True)
    master = MasterProcess(fleet.group, 11311, fleet.folder, wire.there, wire.prefix)
    # As in `docs/several-hosts.md`: the robot's own nodes do not depend on its address.
    master.environment.update(ROS_IP="127.0.0.1", ROS_MASTER_URI="http://127.0.0.1:11311/")
    base, robot = fleet.site("base"), fleet.site("robot", master, wire.prefix)
    base.start({"ROS_IP": wire.here}, insecure=True)
    robot.start(insecure=True)
    base.connected()
    logs = {}
    for topic, (size, rate) in TOPICS.items():
        robot.probe("load", f"source{topic.replace('/', '_')}", topic, size, rate)
        logs[topic] = fleet.folder / f"{topic[1:]}.log"
        base.probe("check", f"sink{topic.replace('/', '_')}", topic, log=logs[topic])
        assert base.flip("robot", "subscriber", topic) == 0
    for topic, log in logs.items():
        wait_until(lambda one=log: one.exists() and checked(one), f"{topic} at the base", START)
    yield base, robot, logs
    wire.set(FINE)


def flows(log: Path, since: float, count: int = 10) -> bool:
    return len([row for row in checked(log) if row[0] > since]) >= count


def say(*cells: str) -> None:
    sys.stdout.write(f"| {' | '.join(cells)} |\n")
    sys.stdout.flush()


def available(site) -> list[bool]:
    """Returns whether each other gateway on the hub is available; empty if the hub has forgotten them."""
    answer = site.call("remote_gateway_info", srv.RemoteGatewayInfo)
    return [one.conn_stats.gateway_available for one in answer.gateways]


class Watch:
    """What a base station notices of a fault."""

    def __init__(self, base) -> None:
        self._base = base
        self._began = time.monotonic()
        self.noticed: float | None = None  #: after how long a topic was unregistered [s]
        #: whether the robot's gateway was available, at each change
        self.available: list[bool] = []
        self._asked = self._began

    def look(self) -> bool:
        now = time.monotonic() - self._began
        if time.monotonic() - self._asked > AVAILABILITY_PERIOD:
            self._asked = time.monotonic()
            for is_available in available(self._base):
                if self.available[-1:] != [is_available]:
                    self.available.append(is_available)
        if self.noticed is None and not all(self._base.publishers(topic) for topic in TOPICS):
            self.noticed = now
        return False


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_a_fault_of_the_network(wire, far, fault: Fault) -> None:
    base, _robot, logs = far
    before = {topic: checked(log)[-1][1] for topic, log in logs.items()}
    began = time.monotonic()
    wire.set(fault.out, fault.back)
    watch = Watch(base)
    with pytest.raises(WaitError):
        wait_until(watch.look, "nothing", fault.seconds)
    ended = time.monotonic()
    wire.set(FINE)
    during = {
        topic: [row for row in checked(log) if began < row[0] <= ended]
        for topic, log in logs.items()
    }
    recovered = {}
    for topic, log in logs.items():
        wait_until(lambda one=log: flows(one, ended), f"{topic} again", RECOVERY)
        recovered[topic] = min(row[0] for row in checked(log) if row[0] > ended) - ended
    wait_until(
        lambda: all(text.startswith(("active", "mtu")) for text in base.states().values()),
        "active rules",
        RECOVERY,
    )
    shares, losses = [], []
    for topic, (_, rate) in TOPICS.items():
        rows = checked(logs[topic])
        assert all(good for *_, good in rows)
        numbers = [number for _, number, _ in rows]
        assert numbers == sorted(set(numbers)), f"{topic}: twice, or out of order"
        past = [number for number in numbers if number > before[topic]]
        lost = past[-1] - before[topic] - len(past)
        shares.append(f"{100 * len(during[topic]) / (rate * fault.seconds):.0f} %")
        losses.append(str(lost))
    say(
        fault.name,
        f"{fault.seconds:g} s",
        "–" if watch.noticed is None else f"{watch.noticed:.1f} s",
        ", ".join(shares),
        ", ".join(losses),
        ", ".join(f"{seconds:.1f}" for seconds in recovered.values()) + " s",
    )
    if CUT in (fault.out, fault.back):
        assert watch.available in ([True], [True, False]), "a cut gateway became available again"
    if fault.out == CUT and fault.seconds > 15:
        assert watch.noticed is not None
        assert watch.noticed <= 10.0


def test_a_robot_that_changes_its_address(wire, far) -> None:
    base, _robot, logs = far
    began = time.monotonic()
    wire.run("ip", "address", "del", f"{wire.there}/29", "dev", "wire")
    wire.run("ip", "address", "add", f"{wire.elsewhere}/29", "dev", "wire")
    watch = Watch(base)
    moved = time.monotonic()
    for topic, log in logs.items():
        wait_until(
            lambda one=log: watch.look() or flows(one, moved + 3.0),
            f"{topic} from the new address",
            RECOVERY,
        )
    times = [min(row[0] for row in checked(log) if row[0] > moved + 3.0) for log in logs.values()]
    say(
        "change of address",
        "",
        "–" if watch.noticed is None else f"{watch.noticed:.1f} s",
        "",
        "",
        f"{max(times) - began:.1f} s",
    )
