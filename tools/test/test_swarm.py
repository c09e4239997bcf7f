"""The fleet on a Docker Swarm: the stack file, what is refused before anything starts, and what status shows."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from containers import deployment, registry, swarm
from containers.__main__ import main
from containers.engine import DOCKER, Computer, ContainerError
from containers.layout import stack_text
from containers.report import status_table
from containers.swarm import Node
from pioneer_demo.scenario.option import factor_held

SHIPPED = (Path(__file__).parents[2] / "docker" / "compose.yaml").read_text()
MANAGER = Node("vm", "a", "10.0.0.1", up=True, works=True, base=False, processors=4.0)
WORKER = Node(
    "node1",
    "b",
    "10.0.0.2",
    up=True,
    works=True,
    base=False,
    processors=2.0,
    docker=("docker", "-H", "x"),
)


def stack(robots: int = 6, factor: float = 1.0) -> dict[str, Any]:
    return dict(yaml.safe_load(stack_text(SHIPPED, robots, "node.role==manager", factor)))


def test_the_stack_has_the_computers_of_the_compose_file_with_tls_and_no_published_port() -> None:
    made, composed = stack(), yaml.safe_load(SHIPPED)
    assert set(made["services"]) == {"aadiworkstation", "aadi"}
    for name, like in (("aadiworkstation", "aadiworkstation"), ("aadi", "aadi1")):
        service, before = made["services"][name], composed["services"][like]
        added = set(service["environment"]) - set(before["environment"])
        assert service["environment"].items() >= before["environment"].items()
        assert added == {"ROCON_TLS_DIRECTORY"}
        assert (service["command"], service["image"]) == (before["command"], before["image"])
        assert (
            set(service["secrets"])
            == set(made["secrets"])
            == {"hub_password", "ca.crt", "tls.crt", "tls.key"}
        )
        assert service["healthcheck"] == {
            **before["healthcheck"],
            "interval": "5s",
            "timeout": "20s",
            "retries": 24,
            "start_period": "300s",
        }
        assert not {"ports", "mem_limit", "restart", "profiles"} & set(service)
        assert service["networks"] == ["robots"]
    assert made["networks"]["robots"] == {"driver": "overlay", "internal": True}


def test_robots_are_tasks_of_one_service_which_the_swarm_replaces_one_at_a_time() -> None:
    robots, base = stack()["services"]["aadi"], stack()["services"]["aadiworkstation"]
    assert robots["hostname"] == "aadi{{.Task.Slot}}"
    assert robots["deploy"]["replicas"] == 6
    assert robots["deploy"]["endpoint_mode"] == "dnsrr"
    assert robots["deploy"]["update_config"]["parallelism"] == 1
    assert base["deploy"]["placement"]["constraints"] == ["node.role==manager"]


@pytest.mark.parametrize(("factor", "cpus"), [(1.0, 0.11), (0.5, 0.055), (0.0, 0.11)])
def test_processors_are_reserved_in_proportion_to_the_real_time_factor(
    factor: float, cpus: float
) -> None:
    reserved = stack(factor=factor)["services"]["aadi"]["deploy"]["resources"]["reservations"]
    assert float(reserved["cpus"]) == pytest.approx(cpus)
    assert reserved["memory"] == "200m"


@pytest.mark.parametrize("robots", range(1, 16))
@pytest.mark.parametrize("processors", [1.0, 2.0, 4.0])
def test_a_fleet_at_the_factor_that_the_processors_carry_finds_them_free(
    robots: int, processors: float
) -> None:
    services = stack(robots, factor_held(robots, processors))["services"]
    deployed = [services[name]["deploy"] for name in ("aadiworkstation", "aadi")]
    reserved = sum(
        one["replicas"] * float(one["resources"]["reservations"]["cpus"]) for one in deployed
    )
    assert reserved <= processors


@pytest.fixture
def no_fleet(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Nothing:
        def computers(self) -> list[Computer]:
            return []

    monkeypatch.setattr(deployment, "project", lambda _name: Nothing())
    monkeypatch.setattr(
        deployment, "stack", lambda name: swarm.Stack(name, tmp_path / "stack.yaml")
    )


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("--update", "--update is for a fleet on a swarm"),
        ("--registry r:5000", "--registry is for a fleet on a swarm"),
        ("--swarm --desktop", "--desktop is for a fleet on one machine"),
        ("--swarm --ros2", "--ros2 is for a fleet on one machine"),
        ("--swarm --web", "--web is for a fleet on one machine"),
        ("--swarm --update", "--update is for a fleet that runs"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    no_fleet: None, words: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["up", *words.split()]) == 1
    assert why in capsys.readouterr().err


def answers(**by_verb: object) -> Callable[..., str]:
    """Returns a fake engine that answers each verb with a value, encoded as JSON unless it is a string."""

    def output(*command: str) -> str:
        found = by_verb[next(word for word in command[1:] if word in by_verb)]
        return found if isinstance(found, str) else json.dumps(found)

    return output


def test_an_engine_that_manages_no_swarm_is_an_error_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        swarm, "output", answers(info={"LocalNodeState": "inactive", "ControlAvailable": False})
    )
    with pytest.raises(ContainerError, match="docker swarm init --advertise-addr"):
        swarm.nodes()


def fact(
    ident: str, name: str, state: str = "ready", availability: str = "active"
) -> dict[str, Any]:
    resources = {"NanoCPUs": 2000000000, "MemoryBytes": 1}
    return {
        "ID": ident,
        "Description": {"Hostname": name, "Resources": resources},
        "Status": {"State": state, "Addr": "10.0.0.9"},
        "Spec": {
            "Availability": availability,
            "Labels": {"pioneer": "base"} if name == "node2" else {},
        },
    }


def test_other_engines_are_reached_by_a_context_of_the_nodes_name_else_by_ssh(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = {"ControlAvailable": True, "NodeID": "a", "NodeAddr": "10.0.0.1"}
    monkeypatch.setattr(
        swarm, "output", answers(info=own, context="default\nnode1\n", node="a\nb\nc\n")
    )
    facts = [fact("b", "node1", availability="drain"), fact("c", "node2", "down"), fact("a", "vm")]
    monkeypatch.setattr(swarm, "_inspected", lambda _kind, _names: facts)
    here, first, second = swarm.nodes()
    assert (here.name, here.docker, here.address) == ("vm", DOCKER, "10.0.0.1")
    assert (first.docker, first.up, first.works) == (("docker", "--context", "node1"), True, False)
    assert (second.docker, second.up, second.base) == (
        ("docker", "-H", "ssh://10.0.0.9"),
        False,
        True,
    )


def test_an_engine_that_does_not_answer_is_named_with_the_command_that_helps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def output(*_command: str) -> str:
        raise ContainerError("no route to host")

    monkeypatch.setattr(swarm, "output", output)
    with pytest.raises(
        ContainerError, match=r"node1 .*no route.*docker context create node1 --docker host=ssh://"
    ):
        swarm.check_engines([WORKER])


@pytest.mark.parametrize("config", [{}, {"10.0.0.1:5000": {"Secure": True}}])
def test_a_node_that_would_not_pull_from_our_registry_is_named(
    config: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "output", answers(info=config))
    with pytest.raises(
        ContainerError, match=r'node1 takes no image .*"insecure-registries": \["10.0.0.1:5000"\]'
    ):
        registry.check_trust(WORKER, "10.0.0.1:5000")
    monkeypatch.setattr(registry, "output", answers(info={"10.0.0.1:5000": {"Secure": False}}))
    registry.check_trust(WORKER, "10.0.0.1:5000")


def task(slot: int, state: str, node: str = "", problem: str = "") -> dict[str, Any]:
    status = {"State": state, "Err": problem, "ContainerStatus": {"ContainerID": f"c{slot}"}}
    spec = {"ContainerSpec": {"Image": "r/pioneer:1", "Env": ["WORLD=utm_0"]}}
    return {
        "ID": f"t{slot}",
        "Slot": slot,
        "Status": status,
        "Spec": spec,
        **({"NodeID": node} if node else {}),
    }


def test_a_task_is_a_computer_on_its_node_and_unreachable_where_that_is_down() -> None:
    known = {
        "b": WORKER,
        "c": Node("node2", "c", "", up=False, works=False, base=False, processors=2.0),
    }
    one, lost, waiting = (
        swarm._computer(found, known)
        for found in (
            task(3, "running", "b"),
            task(4, "running", "c"),
            task(5, "pending", "", "no suitable node (x)"),
        )
    )
    assert (one.name, one.node, one.docker, one.running, one.robot) == (
        "aadi3",
        "node1",
        WORKER.docker,
        True,
        "pioneer3",
    )
    assert (lost.state, lost.running) == ("unreachable", False)
    assert (waiting.node, waiting.problem) == ("", "no suitable node (x)")
    heading, *rows = status_table([one, lost, waiting], {}).splitlines()
    assert heading.split()[:3] == ["COMPUTER", "NODE", "CONTAINER"]
    assert [row.split()[1] for row in rows] == ["node1", "node2", "-"]
    assert rows[2].endswith("no suitable node (x)")


def rejected(name: str, number: int) -> Computer:
    return Computer(
        name,
        "",
        "rejected",
        "",
        {},
        "i",
        "node1",
        task=f"{name}.{number}",
        problem="No such image: i",
    )


def test_a_machine_that_fails_to_begin_a_computer_time_and_again_is_named_with_the_reason() -> None:
    several = [rejected("aadi1", 1), rejected("aadi2", 1), rejected("aadi2", 2)]
    assert deployment._failing(several) == ""
    assert (
        deployment._failing([*several, rejected("aadi2", 3)])
        == "node1 cannot start aadi2: No such image: i"
    )


@pytest.mark.parametrize(
    ("there", "done"),
    [
        ("", ["docker run"]),
        ("10.0.0.1 running", []),
        ("10.0.0.1 exited", ["docker start"]),
        ("10.9.9.9 running", ["docker rm", "docker run"]),
        ("running", ["docker rm", "docker run"]),
    ],
)
def test_a_registry_of_a_former_address_or_version_is_replaced(
    there: str, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[str] = []

    def output(*command: str) -> str:
        if command[1] != "ps":
            called.append(" ".join(command[:2]))
        return there if command[1] == "ps" else ""

    monkeypatch.setattr(registry, "output", output)
    monkeypatch.setattr(registry, "ensure_registry_image", lambda *_: None)
    monkeypatch.setattr(registry, "_answers", lambda *_: True)
    registry._start("10.0.0.1")
    assert called == done


def test_a_fleet_on_a_swarm_that_is_gone_is_forgotten(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`down` used to fail forever: the stack file indicated a fleet, but the engine did not manage a swarm."""
    gone = swarm.Stack("pioneer", tmp_path / "stack.yaml")
    gone.file.touch()
    monkeypatch.setattr(swarm, "output", lambda *command: {"info": "inactive\n"}[command[1]])
    gone.down()
    assert not gone.file.exists()
