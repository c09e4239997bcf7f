"""Pitfalls from the tutorial's appendix, tested from outside: one test per row of the table in docs/differences.md."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import rospkg
import yaml
from gateway_msgs import msg

from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

TF_PROBE = Path(__file__).with_name("tf_probe.py")


def test_a_typing_error_in_gateway_topic_or_node_is_answered_with_the_nearest_name(
    standing: Any,
) -> None:
    base, robot = standing
    robot.talk("/p1/odom")
    base.talk("/plan", "planner")
    robot.talk("/p1/plan", "p1_planner")
    base.hear("/p1/plan", "rviz")
    assert base.flip("robto", "subscriber", "/p1/scan") == 0
    assert base.flip("robot", "subscriber", "/p1/odmo") == 0
    assert base.flip("robot", "publisher", "/plan", "/planer") == 0
    assert base.flip("robot", "subscriber", "/p1/plan", "/rvzi") == 0
    for rule, answer in (
        ("flip /p1/scan", "no such gateway: nearest on the hub: robot"),
        ("flip /p1/odmo", "no such topic: nearest there: /p1/odom"),
        ("flip /plan", "no publisher: here it is published by /planner, not /planer"),
        (
            "flip /p1/plan",
            "active: for /rvzi, which does not listen yet; here it is also subscribed by /rviz",
        ),
    ):
        wait_until(
            lambda rule=rule, answer=answer: base.states()[rule].startswith(answer),
            f"{answer}, not {base.states()}",
            15,
        )


def test_what_the_fleets_blacklist_bars_is_refused_and_the_answer_names_the_rule(
    fleet: Any,
) -> None:
    config = (
        Path(rospkg.RosPack().get_path("pioneer_networking"))
        / "config"
        / "blacklist_multi_pioneer.yaml"
    )
    blacklist = yaml.safe_load(config.read_text())
    fleet.start_hub()
    base, robot = (
        fleet.site("base").start().connected(),
        fleet.site("robot").start(**blacklist).connected(),
    )
    robot.talk("/rosout_of_mine")
    refused = robot.remote("flip", "base", "publisher", "/rosout_of_mine")
    assert refused.result == msg.ErrorCodes.HUB_UNKNOWN_ERROR
    assert "blacklisted by publisher /rosout.*" in refused.error_message
    refused = robot.advertise("/rosout_of_mine")
    assert refused.result == msg.ErrorCodes.UNKNOWN_ADVERTISEMENT_ERROR
    assert "blacklisted by publisher /rosout.*" in refused.error_message
    # A remote gateway that requests it sees the refusal in the rule's state.
    assert base.flip("robot", "subscriber", "/rosout_of_mine") == 0
    wait_until(
        lambda: base.states()["flip /rosout_of_mine"].startswith("blacklisted"),
        "the rule's answer",
        10,
    )
    assert "/rosout.*" in base.states()["flip /rosout_of_mine"]
    assert base.publishers("/rosout_of_mine") == []


def test_a_pattern_brings_no_other_robots_topics_in_unless_it_spells_them_out(fleet: Any) -> None:
    fleet.start_hub()
    base = fleet.site("base").start().connected()
    robot = fleet.site("robot").start(namespace="pioneer1").connected()
    for number in (1, 2):
        base.talk(f"/pioneer{number}/odom", f"talker_{number}")
    assert base.advertise("/pioneer1/odom", "/pioneer2/odom").result == 0
    assert robot.pull("base", "publisher", "/.*odom") == 0
    own = robot.hear("/pioneer1/odom", "own")
    own.first_after(0.0)
    assert robot.publishers("/pioneer2/odom") == []
    assert robot.pull("base", "publisher", "/pioneer2/odom") == 0
    other = robot.hear("/pioneer2/odom", "other")
    other.first_after(0.0)


def test_of_tf_only_the_asked_for_prefix_crosses(fleet: Any) -> None:
    fleet.start_hub()
    options = [{"name": "/tf", "gateway": "base", "tf_frames": "pioneer1/.*"}]
    robot = fleet.site("robot").start(rule_options=options).connected()
    base = fleet.site("base").start().connected()
    log = fleet.folder / "frames.log"
    start = fleet.group.start
    start(
        "tf talker",
        [sys.executable, str(TF_PROBE), "talk"],
        robot.master.environment,
        fleet.folder / "t.log",
        True,
    )
    start("tf hearer", [sys.executable, str(TF_PROBE), "hear"], base.master.environment, log, True)
    wait_until(lambda: robot.publishers("/tf"), "tf's publisher", START)
    assert base.flip("robot", "subscriber", "/tf") == 0
    wait_until(lambda: log.exists() and log.read_text().count("\n") > 10, "transforms", START)
    assert set(log.read_text().split()) == {"pioneer1/odom", "pioneer1/base_link"}


def test_an_identical_rule_is_refused_with_rocons_code_and_the_running_one_continues(
    standing: Any,
) -> None:
    base, robot = standing
    robot.talk("/p1/scan")
    ear = base.hear("/p1/scan")
    assert base.flip("robot", "subscriber", "/p1/scan") == 0
    ear.first_after(0.0)
    for _ in range(5):
        assert (
            base.flip("robot", "subscriber", "/p1/scan") == msg.ErrorCodes.FLIP_RULE_ALREADY_EXISTS
        )
    ear.first_after(time.monotonic())
    gaps = [late - early for early, late in itertools.pairwise(ear.times())]
    assert max(gaps) < 1.0, "the probe publishes ten times a second"
    assert base.states()["flip /p1/scan"] == "active"


def test_with_an_anaconda_first_on_the_path_everything_runs_and_doctor_reports_it(
    fleet: Any,
) -> None:
    folder = fleet.folder / "anaconda" / "bin"
    folder.mkdir(parents=True)
    for name in ("python", "python3"):
        (folder / name).write_text(
            "#!/bin/sh\necho \"ModuleNotFoundError: No module named 'rospy'\" >&2\nexit 1\n"
        )
        (folder / name).chmod(0o755)
    environment = {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    fleet.start_hub(environment)
    base = fleet.site("base").start(environment).connected()
    command = ["rosrun", "rocon_gateway", "doctor"]
    variables = {**base.master.environment, **environment}
    done = subprocess.run(
        command, env=variables, capture_output=True, text=True, check=False, timeout=60
    )
    said = done.stdout + done.stderr
    assert f"the first python3 on the PATH, {folder}/python3, cannot import rospy" in said
    assert f"→ export PATH={Path(sys.executable).parent}:$PATH" in said
    assert done.returncode == 0, said


def test_a_hub_that_goes_and_comes_is_one_line_each_in_every_gateway(pair: Any, fleet: Any) -> None:
    pair[1].talk("/a")
    ear = pair[0].hear("/a")
    assert pair[0].flip("robot", "subscriber", "/a") == 0
    ear.first_after(0.0)
    before = [site.log.read_text() for site in pair]
    os.kill(fleet.hub_pid, signal.SIGINT)
    wait_until(
        lambda: not any(site.info().connected for site in pair), "gateways without a hub", 10
    )
    gone = time.monotonic()
    # Meanwhile they retry and log nothing.
    wait_until(lambda: time.monotonic() - gone > 5.0, "attempts of some seconds", 10)
    fleet.start_hub()
    for site in pair:
        wait_until(lambda site=site: site.info().connected, f"{site.name} on the new hub", 30)
    wait_until(lambda: pair[0].states()["flip /a"] == "active", "the rule", 10)
    for site, text in zip(pair, before, strict=True):
        later = [
            line
            for line in site.log.read_text().removeprefix(text).splitlines()
            if "hub" in line.lower()
        ]
        assert len(later) == 2, later
        assert "lost" in later[0]
        assert "on hub" in later[1]
    gaps = [late - early for early, late in itertools.pairwise(ear.times())]
    assert max(gaps) < 2.0, "data continues without the hub"


@pytest.mark.parametrize("order", ["hub base robot", "robot hub base", "base robot hub"])
def test_ctrl_c_in_any_order_ends_each_at_once_with_status_0(
    pair: Any, fleet: Any, order: str
) -> None:
    base, robot = pair
    robot.talk("/a")
    base.flip("robot", "subscriber", "/a")
    wait_until(lambda: base.publishers("/a"), "the proxy", 10)
    pids = {"hub": fleet.hub_pid, "base": base.pid, "robot": robot.pid}
    for name in order.split():
        os.kill(pids[name], signal.SIGINT)
        wait_until(lambda name=name: not fleet.group.is_running(name), f"the end of {name}", 5)
    assert {death.name: death.status for death in fleet.group.deaths} == {
        "hub": 0,
        "base": 0,
        "robot": 0,
    }
