"""A network between two machines that is cut, slow, lossy or limited in bandwidth."""

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from gateway_msgs import msg, srv
from measure import MB, checked, memory
from tcp_proxy import TcpProxy

from pioneer_harness.machine import MachineError
from pioneer_harness.masters import MasterProcess
from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.fixture(scope="module")
def far(machine, shared_fleet):
    """A base station here and a robot on another machine, whose stream of small messages is flipped to the base."""
    fleet = shared_fleet
    fleet.hub_uri = f"http://{machine.here}:{fleet.hub_port}"
    fleet.start_hub(insecure=True)
    master = MasterProcess(fleet.group, 11311, fleet.folder, machine.there, machine.prefix)
    base, robot = fleet.site("base"), fleet.site("robot", master, machine.prefix)
    base.start({"ROS_IP": machine.here}, insecure=True)
    robot.start(insecure=True).connected()
    base.connected()
    robot.probe("load", "small_source", "/small", 64, 20)
    log = fleet.folder / "small.log"
    base.probe("check", "small_sink", "/small", log=log)
    assert base.flip("robot", "subscriber", "/small") == 0
    wait_until(lambda: log.exists() and checked(log), "messages of the other machine", START)
    return base, robot, log


def doctor(site) -> str:
    """Returns the report of the doctor."""
    argv = ["rosrun", "rocon_gateway", "doctor"]
    done = subprocess.run(
        argv, env=site.master.environment, capture_output=True, text=True, timeout=60, check=False
    )
    return done.stdout + done.stderr


def since(log: Path, moment: float) -> list[tuple[float, int, bool]]:
    return [row for row in checked(log) if row[0] > moment]


def test_on_1_mbit_small_messages_go_on_beside_too_many_large_ones(machine, far) -> None:
    base, robot, log = far
    big = log.with_name("big.log")
    base.probe("check", "big_sink", "/big", log=big)
    robot.probe("load", "big_source", "/big", 60_000, 20)
    machine.narrow("1mbit")
    try:
        assert base.flip("robot", "subscriber", "/big") == 0
        wait_until(lambda: big.exists() and checked(big), "large messages", START)
        before, began = memory(robot.pid), time.monotonic()
        wait_until(lambda: time.monotonic() - began > 6.0, "6 s of narrowness", 8)
        assert len(since(log, began)) > 30
        assert 4 <= len(since(big, began)) <= 20
        assert memory(robot.pid) - before < 20 * MB
        assert (base.info().connected, robot.info().connected) == (True, True)
    finally:
        machine.widen()
    wide = time.monotonic()
    wait_until(lambda: len(since(big, wide)) > 20, "large messages at their full rate", 10)
    assert base.flip("robot", "subscriber", "/big", cancel=True) == 0
    assert all(good for path in (log, big) for *_, good in checked(path))
    assert base.states() == {"flip /small": "active"}


def test_one_packet_of_twenty_may_be_lost(machine, far) -> None:
    base, _, log = far
    try:
        machine.lose(0.05)
    except MachineError as error:
        pytest.skip(f"loss is not tested here: {error}")
    try:
        began = time.monotonic()
        wait_until(lambda: len(since(log, began)) > 60, "messages through the loss", 12)
    finally:
        machine.run("iptables", "-F", "INPUT")
    numbers = [number for _, number, _ in checked(log)]
    assert numbers == sorted(set(numbers))
    assert base.states()["flip /small"] == "active"


@pytest.mark.parametrize("mtu", [1000, 576])
def test_a_path_that_swallows_large_packets_is_detected_and_carries_large_messages(
    machine, far, report, mtu
) -> None:
    base, robot, log = far
    big = log.with_name(f"big_{mtu}.log")
    base.probe("check", "big_sink", "/big", log=big)
    robot.probe("load", "big_source", "/big", 60_000, 20)
    assert base.flip("robot", "subscriber", "/big") == 0
    wait_until(lambda: big.exists() and checked(big), "large messages", START)
    began = time.monotonic()
    try:
        machine.swallow(mtu)
    except MachineError as error:
        pytest.skip(f"the size of packets is not tested here: {error}")
    try:
        wait_until(lambda: len(since(big, began + 2.0)) > 20, "large messages again", 40)
        report(f"MTU {mtu}: large messages again", since(big, began + 2.0)[0][0] - began)
        wait_until(
            lambda: base.states()["flip /big"].startswith("mtu: full packets do not arrive"),
            "a state with the advice",
            5,
        )
        examined = doctor(base)
        assert "the path to gateway 'robot': full packets do not arrive" in examined, examined
        assert "does not answer the doctor" not in examined, examined
        wait_until(lambda: len(since(log, time.monotonic() - 1.0)) > 5, "small messages, too", 20)
    finally:
        machine.pass_all()
        for name in ("big_sink", "big_source"):
            (base if name == "big_sink" else robot).end_probe(name)
        assert base.flip("robot", "subscriber", "/big", cancel=True) == 0
    assert "small packets arrive, full packets do not" in base.log.read_text()
    numbers = [number for _, number, _ in checked(big)]
    assert numbers == sorted(set(numbers)), "none came twice"


@pytest.mark.parametrize("mtu", [1000, 576])
def test_the_hub_carries_long_lists_of_rules_on_a_path_that_swallows_large_packets(
    machine, far, mtu
) -> None:
    """Records longer than a packet once cost a robot its hub on such a path."""
    base, robot, _ = far
    names = [f"/topic_with_a_rather_long_name/{mtu}/{number}" for number in range(100)]
    rules = [msg.RemoteRule("robot", msg.Rule("subscriber", name, "")) for name in names]
    losses = robot.log.read_text().count("lost")
    try:
        machine.swallow(mtu)
    except MachineError as error:
        pytest.skip(f"the size of packets is not tested here: {error}")
    try:
        assert base.call("flip", srv.Remote, remotes=rules).result == 0
        # The robot's own words: it got the long request, and its long record got back.
        wait_until(
            lambda: all(
                base.states()[f"flip {name}"].startswith("no such topic") for name in names
            ),
            "the robot's answers",
            15,
        )
    finally:
        machine.pass_all()
        assert base.call("flip", srv.Remote, remotes=rules, cancel=True).result == 0
    assert (base.info().connected, robot.info().connected) == (True, True)
    assert robot.log.read_text().count("lost") == losses


def test_a_host_that_disappears_is_noticed_within_10_s_and_reconnects(machine, far, report) -> None:
    base, _, log = far
    machine.unplug()
    cut = time.monotonic()
    wait_until(lambda: base.publishers("/small") == [], "the far side is unregistered", 15)
    noticed = time.monotonic() - cut
    report("link cut without a packet, noticed", noticed)
    wait_until(lambda: base.states()["flip /small"] != "active", "the rule's state to change", 2)
    machine.plug()
    back = time.monotonic()
    wait_until(lambda: since(log, back), "messages again", 20)
    report("link mended, messages again", time.monotonic() - back)
    # Links may still use the smaller segments of an earlier test.
    wait_until(lambda: base.states()["flip /small"].startswith(("active", "mtu")), "active", 5)
    assert noticed <= 10.0
    numbers = [number for _, number, _ in checked(log)]
    assert numbers == sorted(set(numbers)), "none came twice"


def test_a_link_dropped_by_a_middlebox_is_noticed_within_10_s(machine, far, report) -> None:
    base, robot, log = far
    port = str(robot.relay_port())
    rules = [("INPUT", "-p", "tcp", "--dport", port), ("OUTPUT", "-p", "tcp", "--sport", port)]
    done = []
    cut = time.monotonic()
    try:
        for rule in rules:
            try:
                machine.run("iptables", "-A", *rule, "-j", "DROP")
            except MachineError as error:
                pytest.skip(f"a port cannot be blocked here: {error}")
            done.append(rule)
        wait_until(lambda: base.publishers("/small") == [], "the far side is unregistered", 15)
        noticed = time.monotonic() - cut
        wait_until(
            lambda: base.states()["flip /small"].startswith("unreachable"),
            "the rule's state to change",
            5,
        )
        assert (base.info().connected, robot.info().connected) == (True, True)
    finally:
        for rule in done:
            machine.run("iptables", "-D", *rule, "-j", "DROP")
    report("link dropped on the way, noticed", noticed)
    back = time.monotonic()
    wait_until(lambda: since(log, back), "messages again", 20)
    assert noticed <= 10.0


@pytest.fixture
def behind_proxy(fleet) -> Iterator[tuple]:
    """A robot that reaches the hub through a proxy, and a base station that connects directly."""
    fleet.start_hub()
    base = fleet.site("base").start().connected()
    proxy = TcpProxy("127.0.0.1", fleet.hub_port)
    robot = fleet.site("robot").start(hub_uri=f"http://127.0.0.1:{proxy.port}").connected()
    robot.talk("/a")
    yield base, robot, proxy
    robot.stop()
    proxy.close()


def test_rules_work_over_a_hub_that_is_200_ms_away(behind_proxy, report) -> None:
    base, robot, proxy = behind_proxy
    proxy.delay = 0.2
    ear = base.hear("/a")
    asked = time.monotonic()
    assert base.flip("robot", "subscriber", "/a") == 0
    report("flip with 200 ms to the hub", ear.first_after(asked))
    wait_until(lambda: base.states() == {"flip /a": "active"}, "active", 5)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 4.0, "longer than a sign of life lasts", 6)
    assert robot.info().connected
    assert robot.log.read_text().count("lost") == 0


def test_a_peer_from_which_nothing_comes_any_more_is_noticed_within_10_s(
    fleet, behind_proxy, report
) -> None:
    """Emulates a cut cable on machines without network namespaces; the kernels keep acknowledging."""
    base, robot, proxy = behind_proxy
    ear = base.hear("/a")
    assert base.flip("robot", "subscriber", "/a") == 0
    ear.first_after(0.0)
    proxy.swallows = True
    silenced = fleet.family(robot.pid)
    fleet.signal(silenced, signal.SIGSTOP)
    cut = time.monotonic()
    try:
        wait_until(lambda: base.publishers("/a") == [], "the far side is unregistered", 15)
        noticed = time.monotonic() - cut
        report("silent peer noticed", noticed)
    finally:
        fleet.signal(silenced, signal.SIGCONT)
    proxy.swallows = False
    back = time.monotonic()
    ear.first_after(back, timeout=20)
    assert noticed <= 10.0
