"""The rules that each script requests from its gateway, and how it handles an invalid command line."""

import sys
from collections.abc import Callable, Sequence

import pytest

from rocon_flip import command
from rocon_flip.rule_set import Action, Wish

Asked = tuple[Action, list[Wish], bool]


class FakeGateway:
    """Records all requests; refuses them unless `accepts` is set."""

    asked: list[Asked]
    accepts = True

    def wait(self) -> None:
        """Returns at once: the fake gateway is always ready."""

    def ask(self, action: Action, wishes: Sequence[Wish], cancel: bool) -> bool:
        self.asked.append((action, list(wishes), cancel))
        return self.accepts


@pytest.fixture
def gateway(monkeypatch: pytest.MonkeyPatch) -> type[FakeGateway]:
    kind = type("Gateway", (FakeGateway,), {"asked": []})
    monkeypatch.setattr(command, "GatewayClient", kind)
    monkeypatch.setattr(command.rospy, "init_node", lambda *_, **__: None)
    for name in ("ROBOTS", "ROBOT_NAME", "HOSTNAME"):
        monkeypatch.delenv(name, raising=False)
    return kind


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    def script(name: str, *arguments: str) -> int:
        monkeypatch.setattr(sys, "argv", [name, *arguments, "__name:=ignored"])
        return command.run(name)

    return script


HUB = "Hub_Gateway"


@pytest.mark.parametrize(
    ("script", "arguments", "action", "wishes"),
    [
        ("advertise_hub_publisher.py", ["map"], Action.ADVERTISE, [Wish("publisher", "/map")]),
        ("pull_hub_publisher.py", ["/map"], Action.PULL, [Wish("publisher", "/map", "", HUB)]),
        (
            "flip_hub_subscriber.py",
            ["pioneer1", "odom", "rviz", "aadi1"],
            Action.FLIP,
            [Wish("subscriber", "/pioneer1/odom", "/rviz", "aadi1_gateway")],
        ),
        (
            "flip_hub_publisher.py",
            ["pioneer1", "map_goal", "", "aadi1"],
            Action.FLIP,
            [Wish("publisher", "/pioneer1/map_goal", "", "aadi1_gateway")],
        ),
        (
            "flip_hub_publisher.py",
            ["goal", "aadi2"],
            Action.FLIP,
            [Wish("publisher", "/goal", "", "aadi2_gateway")],
        ),
        (
            "flip_remote_subscriber.py",
            ["pioneer1", "odom", "/amcl"],
            Action.FLIP,
            [Wish("subscriber", "/pioneer1/odom", "/amcl", HUB)],
        ),
        (
            "flip_remote_publisher.py",
            ["pioneer1", "/tf", ""],
            Action.FLIP,
            [Wish("publisher", "/tf", "", HUB)],
        ),
        (
            "flip-lockstep",
            ["pioneer2"],
            Action.FLIP,
            [
                Wish("subscriber", "/pioneer2/lockstep/period", "", "Hub_Gateway"),
                Wish("subscriber", "/pioneer2/lockstep/probe", "", "Hub_Gateway"),
                Wish("publisher", "/pioneer2/lockstep/done", "", "Hub_Gateway"),
            ],
        ),
        (
            "flip-traffic",
            [],
            Action.FLIP,
            [Wish("publisher", "/traffic/reports", "", "aadi.*_gateway")],
        ),
        (
            "generic_advertiser.py",
            ["-t", "odom", "-l", "pioneer1", "-n", "gazebo"],
            Action.ADVERTISE,
            [Wish("publisher", "/pioneer1/odom", "/gazebo")],
        ),
        (
            "generic_puller.py",
            ["-g", HUB, "-t", "/map", "-r", "pioneer1"],
            Action.PULL,
            [Wish("publisher", "/map", "", HUB)],
        ),
        (
            "generic_flip_publisher.py",
            ["-g", HUB, "-t", "cmd_vel", "-l", "/pioneer1/", "-r", "pioneer1"],
            Action.FLIP,
            [Wish("publisher", "/pioneer1/cmd_vel", "", HUB)],
        ),
        (
            "generic_flip_subscriber.py",
            ["-g", HUB, "-t", "odom", "-r", "pioneer1"],
            Action.FLIP,
            [Wish("subscriber", "/pioneer1/odom", "", HUB)],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("cancel", [False, True])
def test_a_script_asks_for_its_rule_or_takes_it_back(
    run, gateway, script, arguments, action, wishes, cancel
) -> None:
    assert run(script, *arguments, *["--cancel"] * cancel) == 0
    assert gateway.asked == [(action, wishes, cancel)]


def test_the_hub_flips_for_the_robots_and_the_node_of_its_command_line(run, gateway) -> None:
    assert run("flip-from-hub", "2", "/rviz") == 0
    ((action, wishes, cancel),) = gateway.asked
    assert (action, len(wishes), cancel) == (Action.FLIP, 12, False)
    assert {(one.node, one.gateway) for one in wishes} == {
        ("/rviz", "aadi1_gateway"),
        ("/rviz", "aadi2_gateway"),
    }


def test_rvizs_tools_are_flipped_for_as_many_robots_as_the_environment_says(
    run, gateway, monkeypatch
) -> None:
    monkeypatch.setenv("ROBOTS", "3")
    assert run("flip-tools-from-hub") == 0
    assert {one.gateway for one in gateway.asked[0][1]} == {
        f"aadi{number}_gateway" for number in (1, 2, 3)
    }


def test_a_robot_flips_for_its_own_name_and_laser(run, gateway, monkeypatch) -> None:
    monkeypatch.setenv("HOSTNAME", "aadi4")
    assert run("flip-from-remote") == run("flip-from-remote", "rover", "scan") == 0
    names = [[one.name for one in wishes] for _, wishes, _ in gateway.asked]
    assert names == [
        ["/pioneer4/base_scan", "/pioneer4/odom", "/pioneer4/pioneer/cmd_vel"],
        ["/rover/scan", "/rover/odom", "/rover/pioneer/cmd_vel"],
    ]


def test_one_command_pulls_or_advertises_what_all_share_and_flips(run, gateway) -> None:
    assert (
        run("flip-from-remote", "--pull", "pioneer2")
        == run("flip-from-hub", "--advertise", "1")
        == 0
    )
    assert [action for action, _, _ in gateway.asked] == [
        Action.PULL,
        Action.FLIP,
        Action.ADVERTISE,
        Action.FLIP,
    ]
    assert [one.name for one in gateway.asked[0][1]] == [
        "/clock",
        "/map",
        "/tf",
        "/tf_static",
        "/world_name",
    ]
    assert gateway.asked[1][1][0] == Wish("subscriber", "/pioneer2/base_scan", "", HUB)
    assert run("flip-from-hub", "--pull", "1") == 2


def test_a_refusal_is_the_scripts_status(run, gateway) -> None:
    gateway.accepts = False
    assert run("advertise-from-hub") == 1
    assert run("pull-from-hub") == 1


@pytest.mark.parametrize(
    ("script", "arguments", "words"),
    [
        ("advertise-from-hub", ["more"], "Usage: advertise-from-hub [--cancel]"),
        ("pull_hub_publisher.py", [], "Usage: pull_hub_publisher.py topic"),
        (
            "flip_remote_publisher.py",
            ["pioneer1", "odom"],
            "Usage: flip_remote_publisher.py namespace topic node",
        ),
        ("flip_hub_publisher.py", ["pioneer1", "odom", "rviz"], "3 arguments are ambiguous"),
        ("flip-from-hub", ["0"], "'0' is not a number of robots"),
        ("flip-from-hub", ["--robots"], "Usage: flip-from-hub"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_asks_nothing(
    run, gateway, capsys, script, arguments, words
) -> None:
    assert run(script, *arguments) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert gateway.asked == []


def test_help_is_no_error(run, gateway, capsys) -> None:
    assert run("flip-from-hub", "--help") == 0
    assert capsys.readouterr().err.startswith("Usage: flip-from-hub")


def test_a_topic_cannot_have_two_namespaces(run, gateway, capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(
            "generic_flip_publisher.py", "-g", HUB, "-t", "odom", "-l", "pioneer1", "-r", "pioneer2"
        )
    assert "give one namespace" in capsys.readouterr().err
