"""Several gateways with traffic and a fault every 20 s: nothing leaks, is lost or is duplicated.

`PIONEER_SOAK_MINUTES` and `PIONEER_SOAK_SEED` set duration and seed; `./pioneer test --soak` sets both variables.
"""

import itertools
import os
import random
import signal
import socket
import statistics
import sys
import time
from collections.abc import Callable

import pytest
from gateway_msgs import msg, srv
from measure import MB, checked, memory, open_files, threads

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = [
    pytest.mark.soak,
    pytest.mark.filterwarnings(
        "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
    ),
]

PERIOD = 20.0
"""Time between two faults [s]."""

RECOVERY = 15.0
"""Within which all rules must be active again after a fault is over [s]."""

ROBOTS = ("robot1", "robot2", "robot3")


class Soak:
    """A base station and robots: each robot's stream is flipped to the base, and each robot pulls the base's stream."""

    def __init__(self, fleet, seed: int) -> None:
        self.fleet, self.random = fleet, random.Random(seed)
        self.restarts: list[float] = []
        fleet.start_hub()
        self.base = fleet.site("base")
        self.robots = [fleet.site(name) for name in ROBOTS]
        flips = [{"gateway": name, "rule": rule("subscriber", f"/{name}/data")} for name in ROBOTS]
        self.base.start(default_flips=flips, default_advertisements=[rule("publisher", "/all")])
        self.logs = {}
        self.base.probe("load", "all", "/all", 200, 10)
        for robot in self.robots:
            self.start_robot(robot)
            self.talk(robot)
            self.check(self.base, f"/{robot.name}/data")
            self.check(robot, "/all")

    def start_robot(self, robot) -> None:
        robot.start(default_pulls=[{"gateway": "base", "rule": rule("publisher", "/all")}])

    def talk(self, robot) -> None:
        robot.probe("load", f"{robot.name}_source", f"/{robot.name}/data", 200, 10)

    def check(self, site, topic: str) -> None:
        name = f"sink_of{topic.replace('/', '_')}"
        self.logs[site.name, topic] = log = self.fleet.folder / f"{site.name}-{name}.log"
        site.probe("check", name, topic, log=log)

    @property
    def faults(self) -> list[Callable[[], None]]:
        """The faults to inject; each function returns when its fault is over."""
        return [
            self.hub_killed,
            self.hub_frozen,
            self.redis_killed,
            self.gateway_killed,
            self.gateway_stopped,
            self.gateway_frozen_shortly,
            self.gateway_frozen_long,
            self.publisher_restarted,
            self.rules_come_and_go,
            self.garbage,
            self.subscriber_that_never_reads,
        ]

    def hub_killed(self) -> None:
        os.kill(self.fleet.hub_pid, signal.SIGKILL)
        wait_until(lambda: not self.base.info().connected, "hub lost", 10)
        self.fleet.start_hub()

    def hub_frozen(self) -> None:
        self.frozen([self.fleet.redis_pid()], 4.0)

    def redis_killed(self) -> None:
        # If Redis dies often, the hub counts it as failing and shuts down.
        old = self.fleet.redis_pid()
        os.kill(old, signal.SIGKILL)
        wait_until(lambda: self.fleet.redis_pid() not in (0, old), "another Redis", 10)

    def gateway_killed(self) -> None:
        self.ended(signal.SIGKILL)

    def gateway_stopped(self) -> None:
        self.ended(signal.SIGINT)

    def ended(self, how: signal.Signals) -> None:
        # The gateways of the base and the first robot run throughout, so that leaks would show there.
        robot = self.random.choice(self.robots[1:])
        os.kill(robot.pid, how)
        wait_until(lambda: not self.fleet.group.is_running(robot.name), "the gateway's end", 10)
        self.start_robot(robot)

    def gateway_frozen_shortly(self) -> None:
        self.frozen([self.random.choice(self.robots).pid], 1.5)

    def gateway_frozen_long(self) -> None:
        self.frozen([self.random.choice(self.robots).pid], 11.0)

    def frozen(self, pids: list[int], seconds: float) -> None:
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        # The test needs a period in which nothing happens.
        time.sleep(seconds)
        for pid in pids:
            os.kill(pid, signal.SIGCONT)

    def publisher_restarted(self) -> None:
        robot = self.random.choice(self.robots)
        source = f"/{robot.name}/{robot.name}_source"
        robot.end_probe(f"{robot.name}_source")
        wait_until(
            lambda: source not in self.base.publishers(f"/{robot.name}/data"),
            "the publisher's end",
            10,
        )
        self.restarts.append(time.monotonic())
        self.talk(robot)

    def rules_come_and_go(self) -> None:
        rules = [
            msg.RemoteRule("robot.*", msg.Rule("subscriber", f"/soak{number}.*", ""))
            for number in range(200)
        ]
        for cancel in (False, True):
            assert self.base.call("flip", srv.Remote, remotes=rules, cancel=cancel).result == 0

    def garbage(self) -> None:
        robot = self.random.choice(self.robots)
        for _ in range(50):
            with socket.create_connection(("127.0.0.1", robot.relay_port()), 5) as client:
                client.sendall(self.random.randbytes(self.random.randrange(200)))

    def subscriber_that_never_reads(self) -> None:
        robot = self.random.choice(self.robots)
        with self.base.subscription(f"/{robot.name}/{robot.name}_source", f"/{robot.name}/data"):
            time.sleep(3.0)

    def recover(self) -> float:
        """Waits until everything works again; returns how long that took [s]."""
        began = time.monotonic()
        for site, count in ((self.base, len(ROBOTS) + 1), *((robot, 1) for robot in self.robots)):
            wait_until(
                lambda s=site, n=count: list(s.states().values()) == ["active"] * n,
                f"{site.name}'s rules",
                RECOVERY,
            )
        for key, log in self.logs.items():
            wait_until(
                lambda one=log: one.exists() and last_time(one) > began,
                f"messages at {key}",
                RECOVERY,
            )
        return time.monotonic() - began

    def sample(self) -> dict[str, tuple[int, int, int]]:
        """Returns memory, file descriptors and threads of the gateways that run throughout."""
        return {
            site.name: (memory(site.pid), open_files(site.pid), threads(site.pid))
            for site in (self.base, self.robots[0])
        }


def rule(kind: str, name: str) -> dict[str, str]:
    return {"type": kind, "name": name, "node": ""}


def last_time(log) -> float:
    """Returns the time of the last message."""
    with log.open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - 200))
        lines = file.read().splitlines()
    return float(lines[-2].split()[0]) if len(lines) > 2 else 0.0


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def test_a_fault_every_20_s_leaks_nothing_loses_no_rule_and_doubles_no_message(
    fleet, record_property
) -> None:
    minutes = float(os.environ.get("PIONEER_SOAK_MINUTES", "2"))
    seed = int(os.environ.get("PIONEER_SOAK_SEED", "1"))
    soak = Soak(fleet, seed)
    say(f"everything runs after {soak.recover():.1f} s; {minutes:g} minutes of faults, seed {seed}")
    samples, recoveries, faults = [], [], []
    end, due = time.monotonic() + 60 * minutes, time.monotonic()
    while due < end:
        wait_until(lambda moment=due: time.monotonic() >= moment, "the next fault", PERIOD + 1)
        if not faults:
            faults = soak.random.sample(soak.faults, len(soak.faults))
        fault = faults.pop()
        fault()
        recoveries.append(soak.recover())
        samples.append(soak.sample())
        rss, fds, count = samples[-1]["base"]
        left = max(0.0, end - time.monotonic()) / 60
        say(
            f"{fault.__name__:28} well again after {recoveries[-1]:4.1f} s; "
            f"base {rss / MB:.1f} MB, {fds} files, {count} threads; {left:.1f} minutes left"
        )
        due = max(due + PERIOD, time.monotonic())
    verdict(soak, samples, recoveries, record_property)


def verdict(soak, samples, recoveries, record_property) -> None:
    """Compares the observations with the expectations."""
    for key, log in soak.logs.items():
        rows = checked(log)
        assert all(good for *_, good in rows), f"a message at {key} came damaged"
        for (early, before, _), (late, after, _) in itertools.pairwise(rows):
            # A restarted publisher counts from 0 again.
            restarted = any(early < restart < late for restart in soak.restarts)
            assert after > before or restarted, f"{key}: {after} after {before}"
        say(f"{key}: {len(rows)} messages, none twice")
    for name in samples[0]:
        early, late = samples[: max(1, len(samples) // 4)], samples[-max(1, len(samples) // 4) :]
        for what, column, slack in (("memory", 0, 8 * MB), ("files", 1, 2), ("threads", 2, 1)):
            first, last = (
                statistics.median(one[name][column] for one in part) for part in (early, late)
            )
            record_property(f"{name} {what}", f"{first:.0f} → {last:.0f}")
            say(f"{name}: {what} {first:,.0f} at first, {last:,.0f} at last")
            assert last <= first + slack, f"{name}'s {what} grew"
    record_property("recoveries", [round(one, 2) for one in recoveries])
    median, worst = statistics.median(recoveries), max(recoveries)
    say(
        f"{len(recoveries)} faults, well again after {median:.1f} s (median), {worst:.1f} s (worst)"
    )
