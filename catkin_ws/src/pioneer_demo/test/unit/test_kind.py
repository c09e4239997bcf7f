"""Processes are classified by their command lines."""

import pytest

from pioneer_demo.processes.kind import kind


@pytest.mark.parametrize(
    ("line", "name"),
    [
        (
            "/venv/bin/python3 /ws/devel/lib/nav_bundle/amcl scan:=base_scan __name:=amcl __log:=/l",
            "amcl",
        ),
        ("/venv/bin/python3 /ws/devel/lib/nav_bundle/move_base __name:=move_base", "move_base"),
        ("/usr/bin/python3 /usr/bin/rosmaster --core -p 11311", "masters"),
        (
            "/usr/bin/python3 /usr/bin/roslaunch -p 11311 pioneer_networking pioneer_hub.launch",
            "roslaunch",
        ),
        ("/usr/lib/rosout/rosout __name:=rosout", "masters"),
        (
            "python3 /ws/devel/lib/pioneer_gazebo/run-pioneer-nav-local robot_name:=pioneer1",
            "roslaunch",
        ),
        ("python3 /ws/devel/lib/rocon_gateway/gateway __name:=gateway", "gateways"),
        ("/usr/bin/bash /usr/bin/rosrun rocon_flip pull-from-hub", "start-up commands"),
        ("python3 /ws/devel/lib/rocon_flip/flip-from-hub 2", "start-up commands"),
        ("sleep 5", "other"),
        ("", "other"),
    ],
)
def test_a_command_line_has_its_kind(line, name):
    assert kind(line.split()) == name


def test_redis_is_known_though_it_rewrites_its_command_line():
    assert kind(["/usr/bin/redis-server 127.0.0.1:6380"]) == "hub and redis"
