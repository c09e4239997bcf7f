"""The command-line tools against real gateways."""

import json
import os
import re
import shutil
import subprocess
from typing import Any

import pytest

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def tool(site: Any, *argv: str, path: str = "") -> tuple[int, str]:
    """Runs a tool on the site's master with `path` in front of PATH; returns its status and all its output."""
    command = ["rosrun", "rocon_gateway", *argv]
    environment = {**site.master.environment, "PATH": f"{path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    return done.returncode, done.stdout + done.stderr


def test_the_tools_make_rules_and_say_how_they_do(pair, tmp_path) -> None:
    base, robot = pair
    robot.talk("/p1/scan")
    assert tool(base, "flip", "robot", "/p1/scan", "/p1/scam", "-t", "subscriber")[0] == 0
    assert tool(robot, "advertise", "/p1/scan")[0] == 0
    assert tool(base, "pull", "robto", "/p1/scan") == (
        0,
        "done; 'rosrun rocon_gateway rules' shows how the rules do\n",
    )
    status, said = tool(base, "flip", "base", "/p1/scan")
    assert (status, "refused (52)" in said) == (1, True)
    wait_until(lambda: base.states()["flip /p1/scan"] == "active", "the flip", 10)
    wait_until(lambda: "robot" in base.states()["pull /p1/scan"], "the pull's reason", 10)
    wait_until(
        lambda: base.states()["flip /p1/scam"].startswith("no such topic"), "the other's answer", 10
    )

    status, said = tool(base, "rules")
    assert (status, said.count("\n")) == (1, 4), said
    lines = {line.split()[0] + line.split()[3]: line for line in said.splitlines()}
    assert lines["flip/p1/scan"].split()[5] == "active"
    assert re.search("no such topic +nearest there: /p1/scan$", lines["flip/p1/scam"])
    assert re.search("no such gateway +nearest on the hub: robot$", lines["pull/p1/scan"])

    assert f"hub     {base.info().hub_names[0]} at" in tool(base, "gateway_info")[1]
    status, said = tool(base, "remote_gateway_info", "robot", "nobody")
    assert (status, "advertised (1)\n  publisher /p1/scan" in said) == (1, True)
    said = tool(base, "graph")[1]
    assert "flip <-- robot" in said
    assert "pull <-- robto  (no such gateway)" in said
    assert '"robot" -> "base" [color=purple' in tool(base, "graph", "--dot")[1]

    described = {
        name: json.loads(tool(base, name, "--json")[1])
        for name in ("rules", "gateway_info", "graph")
    }
    assert {one["name"]: one["state"] for one in described["rules"]}["/p1/scam"] == "no such topic"
    assert described["gateway_info"]["flip_watchlist"][0]["rule"]["name"] == "/p1/scan"
    assert ["robot", "base"] in [one["ends"] for one in described["graph"]["arrows"]]

    picture = tmp_path / "graph.png"
    if shutil.which("dot") is None:
        refused = (2, "a picture needs Graphviz: apt install graphviz; --dot works without it\n")
        assert tool(base, "graph", "--png", str(picture)) == refused
    drawer = tmp_path / "bin" / "dot"
    drawer.parent.mkdir()
    drawer.write_text('#!/bin/sh\n[ "$1 $2" = "-Tpng -o" ] && exec cat > "$3"\n')
    drawer.chmod(0o755)
    assert tool(base, "graph", "--png", str(picture), path=str(drawer.parent)) == (0, "")
    assert picture.read_text().startswith("digraph gateways {")

    status, said = tool(base, "doctor")
    assert all(f"1 relays answer at gateway '{site.name}'" in said for site in pair)
    assert "1 of 3 rules are active\n         → rosrun rocon_gateway rules says why" in said
    assert status == 0, said


def test_the_tools_say_what_is_missing(fleet) -> None:
    site = fleet.site("base")
    assert tool(site, "rules") == (2, f"no gateway runs on the master {site.master.uri}\n")
    status, said = tool(site, "doctor", "--hub", fleet.hub_uri)
    assert "→ roslaunch pioneer_networking pioneer_gateway.launch" in said
    assert f"the hub at 127.0.0.1:{fleet.hub_port}: Connection refused" in said
    site.master.stop()
    status, said = tool(site, "rules")
    assert (status, "is ROS_MASTER_URI right?" in said) == (2, True)
    assert os.path.exists(site.log) is False


def test_a_subscriber_not_covered_by_a_flip_is_named_by_rules_and_doctor(pair) -> None:
    base, robot = pair
    robot.talk("/tf_of_p1")
    base.hear("/tf_of_p1", "rviz")
    base.hear("/tf_of_p1", "tf_echo")
    assert base.flip("robot", "subscriber", "/tf_of_p1", "/rviz") == 0
    cure = "rosrun rocon_gateway flip robot /tf_of_p1 -t subscriber"
    wait_until(lambda: cure in base.states()["flip /tf_of_p1"], "the reason", 10)
    assert "/tf_echo" in base.states()["flip /tf_of_p1"]
    findings = json.loads(tool(base, "doctor", "--json")[1])["findings"]
    assert [one["fix"] for one in findings if "/tf_echo" in one["what"]] == [cure]
    assert base.log.read_text().count(cure) == 1
    assert tool(base, *cure.split()[2:])[0] == 0
    wait_until(lambda: cure not in str(base.states()), "every node to be covered", 10)


def refused_simulation(master):
    """Starts step 3 on a master where it must fail before it starts a node; returns its error output."""
    command = [
        "rosrun",
        "pioneer_gazebo",
        "run-multi-pioneer-gazebo-master",
        "robots:=1",
        "world_name:=blank",
    ]
    done = subprocess.run(
        command, env=master.environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert "starting blank" not in done.stderr
    return done.stderr


def test_a_robots_own_master_is_refused_for_simulation(fleet):
    fleet.start_hub()
    robot = fleet.site("aadi1").start().connected()
    refused = refused_simulation(robot.master)
    assert "is 'aadi1', and robots pull from Hub_Gateway: export ROS_MASTER_URI" in refused


def test_the_hubs_own_master_is_refused_for_simulation_and_warned_about(fleet) -> None:
    fleet.start_hub()
    nodes = fleet.hub_master.system_state
    wait_until(lambda: "/hub/get_loggers" in nodes()[2], "the hub's node", 30)
    fleet.hub_master.set_param("/gateway", {"name": "one_that_has_ended"})
    refused = refused_simulation(fleet.hub_master)
    assert "is the hub's own ROS master" in refused
    assert "export ROS_MASTER_URI=http://localhost:" in refused
    site = fleet.site("lost", master=fleet.hub_master).start().connected()
    assert "is the hub's own ROS master; a gateway needs one of its own" in site.log.read_text()
