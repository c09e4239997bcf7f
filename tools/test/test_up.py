"""How ``./pioneer up`` handles an existing fleet, with an engine that starts the compose file at once."""

import contextlib
import errno
import os
import re
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from containers import image, state, up
from containers.__main__ import main
from containers.engine import Computer, ContainerError, Project
from containers.fleet_plan import choose_factor, choose_pace, places_here
from containers.layout import SUBNET
from containers.state import BASE
from pioneer_harness.wait import wait_until


class FakeEngine:
    """Computers that run as soon as Compose starts them, and a record of what ``up`` did with them."""

    def __init__(self, file: Path) -> None:
        self.computers: list[Computer] = []  #: the existing computers, in order
        #: executed: commands run at the base station, except queries
        #: composed: arguments of each Compose call
        #: file: where ``up`` writes the compose file
        self.file, self.composed, self.executed = file, list[tuple[str, ...]](), list[str]()
        #: by computer, in the last call: the stage that was waited for, and the number of waypoints that it was sent to
        self.asked: dict[str, tuple[str, int]] = {}
        self.services: set[str] = set()  #: of the extras, those that run
        self.joined = ""  #: the base station's list of robots that have joined

    def project(self, name: str, **variables: str) -> "FakeProject":
        return FakeProject(self, variables)

    def follow(
        self, asked: Sequence[tuple[Computer, Sequence[str]]], heard: Any
    ) -> dict[str, bool]:
        for computer, words in asked:
            value = dict(zip(words[::2], words[1::2], strict=True))
            self.asked[computer.name] = (value["--until"], int(value["--waypoints"]))
        return dict.fromkeys(self.asked, True)

    def output(self, *command: str) -> str:
        if command[-1].startswith("cat "):
            return self.joined
        if command[-1].startswith("echo "):
            self.joined = command[-1].split()[1] + "\n"
        self.executed.append(" ".join(command))
        return ""

    def up(self, line: str = "") -> int:
        """Runs ``./pioneer up`` with these options, after clearing the record of earlier calls."""
        self.composed, self.executed, self.asked = [], [], {}
        return main(["up", *line.split()])


class FakeProject:
    def __init__(self, engine: FakeEngine, variables: dict[str, str]) -> None:
        self._engine, self._variables = engine, variables

    def computers(self) -> list[Computer]:
        return self._engine.computers

    def alone(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def runs(self, service: str) -> bool:
        return service in self._engine.services

    def run(self, *words: str) -> None:
        engine, variables = self._engine, self._variables
        extras = [*filter(None, variables.get("COMPOSE_PROFILES", "").split(","))]
        engine.composed.append((*words, *extras))
        engine.services.update(extras)
        there = {one.name: one for one in engine.computers}
        numbers = sorted(
            int(text) for text in re.findall(r"^  aadi(\d+):", engine.file.read_text(), re.M)
        )
        named = [word for word in words if word.startswith("aadi")]
        for name in named or (BASE, *(f"aadi{number}" for number in numbers)):
            if name in there and (there[name].running or "--no-recreate" in words):
                there[name] = replace(there[name], state="running")
                continue
            environment = {
                "PIONEER_ROLE": variables.get("PIONEER_STEPS", "base" if name == BASE else "robot"),
                "WORLD": variables["PIONEER_WORLD"],
                "ROBOTS": variables["PIONEER_ROBOTS"],
                "REAL_TIME_FACTOR": variables["PIONEER_REAL_TIME_FACTOR"],
            }
            there[name] = Computer(name, f"id-{name}", "running", "", environment, "pioneer")
        engine.computers = list(there.values())


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeEngine:
    monkeypatch.delenv(SUBNET, raising=False)
    monkeypatch.setattr(state, "STATE", tmp_path)
    fake = FakeEngine(state.written_compose("pioneer"))
    monkeypatch.setattr(up, "project", fake.project)
    monkeypatch.setattr(up, "follow", fake.follow)
    monkeypatch.setattr(up, "output", fake.output)
    monkeypatch.setattr(up, "processors", lambda: 8.0)
    for name in ("ensure_image", "ensure_extra_image"):
        monkeypatch.setattr(image, name, lambda *_: None)
    monkeypatch.setattr(image, "_label", lambda _: "")
    return fake


def names(*numbers: int) -> set[str]:
    return {f"aadi{number}" for number in numbers}


def test_a_new_fleet_is_sent_on_a_tour(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert engine.up() == 0
    assert engine.composed == [("up", "-d")]
    assert engine.asked == dict.fromkeys({BASE} | names(1, 2, 3, 4, 5), ("moving", 3))
    assert re.search(r"^5 robots drive after \d+ s$", capsys.readouterr().out, re.M)


def test_no_more_computers_start_at_once_than_the_processors_carry(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """When sixteen computers started on two processors, roslaunch gave up on its own master after ten seconds."""
    monkeypatch.setattr(up, "processors", lambda: 2.0)
    assert engine.up("--robots 15") == 0
    waves = [[BASE, *(f"aadi{n}" for n in range(1, 6))], [f"aadi{n}" for n in range(6, 12)]]
    assert engine.composed == [("up", "-d", *waves[0]), ("up", "-d", *waves[1]), ("up", "-d")]
    assert [re.search(r"id-(\w+)", line)[1] for line in engine.executed] == [*waves[0], *waves[1]]  # type: ignore[index]
    assert engine.asked == dict.fromkeys({BASE} | names(*range(1, 16)), ("moving", 3))
    assert "waiting for aadi6 … aadi11 to start, then for 4 more" in capsys.readouterr().out


def test_without_waypoints_robots_have_to_be_ready(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert engine.up("--robots 2 --waypoints 0") == 0
    assert engine.asked == dict.fromkeys({BASE} | names(1, 2), ("ready", 0))
    assert "2 robots are ready after" in capsys.readouterr().out


def test_a_desktop_on_a_running_fleet_sends_nobody_and_waits_for_nobody(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up()
    assert engine.up("--desktop") == 0
    assert engine.composed == [("up", "-d", "--no-recreate", "desktop")]
    assert engine.asked == {}
    assert "desktop with RViz: http://" in capsys.readouterr().out


def test_the_door_to_ros_2_is_announced_with_a_new_fleet_and_awaited_on_a_running_one(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert engine.up("--ros2") == 0
    assert engine.composed == [("up", "-d", "ros2")]
    assert not any("/ros2_door" in line for line in engine.executed), "it waits for the world"
    said = "Door to ROS 2: domain 7, for nodes on this machine and in 192.168.2.0/24"
    assert said in capsys.readouterr().out
    assert engine.up("--ros2") == 0
    assert engine.composed == [("up", "-d", "--no-recreate", "ros2")]
    assert [line for line in engine.executed if "/ros2_door" in line]


@pytest.mark.parametrize("has_door", [False, True])
def test_robots_that_join_are_flipped_for_ros_2_where_its_door_runs(
    engine: FakeEngine, has_door: bool
) -> None:
    engine.up("--robots 2 --ros2" if has_door else "--robots 2")
    engine.up("--robots 3")
    flips = [line for line in engine.executed if line.endswith("rocon_flip flip-for-ros2 3")]
    assert len(flips) == has_door


def test_the_fleet_page_is_announced_with_a_new_fleet_and_awaited_on_a_running_one(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert engine.up("--web --desktop") == 0
    assert engine.composed == [("up", "-d", "web", "desktop")]
    assert ["/8090" in line for line in engine.executed] == [False], "it waits for the world"
    assert re.search(
        r"^Fleet page, once it is up: http://192\.168\.2\.100:8090/#\S{32}$",
        capsys.readouterr().out,
        re.M,
    )
    assert engine.up("--web") == 0
    assert engine.composed == [("up", "-d", "--no-recreate", "web")]
    assert ["/dev/tcp/$HOSTNAME/8090" in line for line in engine.executed] == [True]
    assert engine.asked == {}


def test_of_a_running_fleet_only_those_that_join_are_sent_and_awaited_moving(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up()
    assert engine.up("--robots 7") == 0
    running = dict.fromkeys({BASE} | names(1, 2, 3, 4, 5), ("ready", 0))
    assert engine.asked == {**running, **dict.fromkeys(names(6, 7), ("moving", 3))}
    assert [
        text for text in engine.executed if "generic_pioneer" in text and "name:=pioneer7" in text
    ]
    assert len([text for text in engine.executed if text.endswith("flip-from-hub 7")]) == 1
    assert "2 more robots drive after" in capsys.readouterr().out


def test_a_fleet_that_runs_as_it_is_asked_for_is_left_alone(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up("--robots 7 --world closed_maze")
    assert engine.up() == 0
    assert set(engine.asked.values()) == {("ready", 0)}
    assert (
        "7 robots, which ran already and are sent nowhere, are ready after"
        in capsys.readouterr().out
    )


def test_a_robot_whose_computer_was_late_and_one_whose_world_began_again_elsewhere_join(
    engine: FakeEngine,
) -> None:
    """Their computers were already running, so `up` did not spawn the robots in the world and no odometry came."""
    engine.up("--robots 2")
    engine.up("--robots 3")
    engine.joined = ""
    assert engine.up() == 0
    assert [text for text in engine.executed if "name:=pioneer3" in text]
    assert engine.up() == 0
    assert not engine.executed


def test_robots_of_an_interrupted_up_are_added_by_the_next(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine.up("--robots 2")
    ended = []

    def interrupted(*command: str) -> str:
        if "name:=pioneer4" in command[-1] and not ended:
            ended.append(command)
            raise KeyboardInterrupt
        return engine.output(*command)

    monkeypatch.setattr(up, "output", interrupted)
    assert engine.up("--robots 5") == 130
    assert engine.joined == "3\n"
    assert engine.up() == 0
    spawned = [re.search(r"name:=(\w+)", text) for text in engine.executed]
    assert [found[1] for found in spawned if found] == ["pioneer4", "pioneer5"]
    assert engine.joined == "5\n"


def test_a_fleet_keeps_its_subnet_in_a_shell_without_the_variable(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(SUBNET, "10.1.2")
    engine.up("--robots 2")
    monkeypatch.delenv(SUBNET)
    assert engine.up("--robots 3") == 0
    assert state.subnet("pioneer") == "10.1.2"
    assert "${PIONEER_SUBNET:-10.1.2}.103" in engine.file.read_text()
    monkeypatch.setenv(SUBNET, "10.1.3")
    capsys.readouterr()
    assert engine.up("--robots 4") == 1
    assert (
        "PIONEER_SUBNET is 10.1.3, and a fleet runs in 10.1.2: ./pioneer down first"
        in capsys.readouterr().err
    )


def test_a_pull_under_a_running_fleet_leaves_it_alone_and_the_next_up_says_so(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(image, "_label", lambda _: image.source_hash())
    engine.up("--robots 2")
    assert engine.up() == 0
    said = (
        "the sources have changed: this fleet keeps its image; for a new one ./pioneer down first"
    )
    assert said not in capsys.readouterr().out
    monkeypatch.setattr(image, "_label", lambda _: "of former sources")
    built: list[str] = []
    monkeypatch.setattr(image, "ensure_image", built.append)
    assert engine.up("--robots 3") == 0
    assert said in capsys.readouterr().out
    assert built == []
    assert engine.composed == [("up", "-d", "--no-recreate")]
    monkeypatch.setenv("PIONEER_IMAGE", "another")
    assert engine.up() == 0
    assert said not in capsys.readouterr().out


def test_an_empty_password_that_a_full_disk_left_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(state, "STATE", tmp_path)
    (tmp_path / "hub-password").touch()
    password = state.secret("hub-password").read_text()
    assert len(password) > 20
    assert state.secret("hub-password").read_text() == password
    assert state.secret("hub-password").stat().st_mode & 0o777 == 0o600


def test_a_full_disk_leaves_no_password(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state, "STATE", tmp_path)

    def full(_: Path, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        with pytest.raises(
            ContainerError, match=r"cannot write .*hub-password: No space left on device"
        ):
            state.secret("hub-password")
    assert list(tmp_path.iterdir()) == []
    assert state.secret("hub-password").read_text().strip()


def test_a_stopped_computer_restarts_and_its_robot_does_not_join_twice(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up()
    engine.up("--robots 6")
    engine.computers[-1] = replace(engine.computers[-1], state="exited")
    assert engine.up() == 0
    assert engine.asked["aadi6"] == ("moving", 3)
    assert "1 more robot drives after" in capsys.readouterr().out
    assert engine.asked["aadi5"] == ("ready", 0)
    assert not engine.executed


def test_the_file_has_every_robot_there_is_and_a_call_that_is_refused_leaves_it(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up("--robots 7")
    before = engine.file.read_text()
    assert "  aadi7:" in before
    for line in ("--robots 5", "--world closed_maze", "--rtf 0.5", "--robots 16", "--waypoints -1"):
        assert engine.up(line) == 1
        assert engine.composed == []
        assert engine.file.read_text() == before
    assert (
        "pioneer: there is a fleet of 7 robots: ./pioneer down first\n" in capsys.readouterr().err
    )
    engine.up()
    assert engine.file.read_text() == before


def test_a_fleet_that_has_ended_comes_back_as_it_was(engine: FakeEngine) -> None:
    engine.up("--robots 6 --world small_world")
    engine.computers = [replace(one, state="exited") for one in engine.computers]
    assert engine.up() == 0
    assert {one.environment["WORLD"] for one in engine.computers} == {"small_world"}
    assert engine.asked == dict.fromkeys({BASE} | names(1, 2, 3, 4, 5, 6), ("moving", 3))


def test_steps_are_never_started_on_an_idle_fleet(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up("--idle")
    for line in ("", "--robots 7", "--robots 7 --desktop"):
        assert engine.up(line) == 1
        assert capsys.readouterr().err == "pioneer: an idle fleet runs: ./pioneer down first\n"
        assert engine.composed == []


def test_more_idle_computers_join_an_idle_fleet_without_a_world_to_join(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up("--idle")
    assert engine.up("--idle --robots 7") == 0
    assert (engine.executed, engine.asked) == ([], {})
    assert {one.environment["PIONEER_ROLE"] for one in engine.computers} == {"idle"}
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "8 computers are up and idle: ./pioneer exec aadiworkstation, ./pioneer exec aadi1, …",
        "step 3 on aadiworkstation now wants robots:=7",
    ]


def test_a_desktop_joins_an_idle_fleet_whose_steps_were_typed(engine: FakeEngine) -> None:
    engine.up("--idle")
    assert engine.up("--desktop") == 0
    assert engine.composed == [("up", "-d", "--no-recreate", "desktop")]
    assert ["/dev/tcp/$HOSTNAME/6080" in line for line in engine.executed] == [True], (
        "its page is waited for"
    )
    assert engine.asked == {}


def test_idle_computers_join_a_running_world_and_are_not_waited_for(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.up()
    assert engine.up("--idle") == 1
    assert "a fleet runs whose steps are started: ./pioneer down first" in capsys.readouterr().err
    assert engine.up("--idle --robots 6") == 0
    assert [text for text in engine.executed if "name:=pioneer6" in text]
    assert "1 computer is up and idle: ./pioneer exec aadi6, …" in capsys.readouterr().out
    engine.up()
    assert set(engine.asked) == {BASE} | names(1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--robots 16", "--robots must be 1 to 15 in utm_0, not 16"),
        ("--robots 0", "--robots must be 1 to 15 in utm_0, not 0"),
        ("--world small_world --robots 7", "--robots must be 1 to 6 in small_world, not 7"),
        ("--world utm0", "--world must be one of blank, closed_maze, "),
        ("--world /home/me/utm_0.world", "not '/home/me/utm_0.world'"),
        ("--waypoints 51", "--waypoints must be 0 to 50, not 51"),
    ],
)
def test_what_no_world_has_is_one_line_before_an_image_is_built(
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    line: str,
    said: str,
) -> None:
    monkeypatch.setattr(image, "ensure_image", lambda *_: pytest.fail("an image is built"))
    assert engine.up(line) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not engine.file.exists()


def test_help_states_how_many_robots_the_worlds_have_places_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert places_here()["utm_0"] == 15
    with pytest.raises(SystemExit):
        main(["up", "--help"])
    assert "at most 15 (6 in small_world, 6 in small_world_people)" in " ".join(
        capsys.readouterr().out.split()
    )


@pytest.mark.parametrize(
    ("robots", "rtf", "running", "factor", "said"),
    [
        (5, None, None, 1.0, ""),
        (13, None, None, 1.0, ""),
        (
            15,
            None,
            None,
            0.9,
            "2 processors sustain 15 robots at a real-time factor of 0.9 (--rtf R sets another)",
        ),
        (15, 1.0, None, 1.0, ""),
        (2, 0.0, None, 0.0, ""),
        (
            15,
            None,
            "1",
            1.0,
            "2 processors sustain 15 robots at a real-time factor of 0.9; the world that runs has 1",
        ),
        (10, None, "0.5", 0.5, ""),
        (2, 0.5, "0.5", 0.5, ""),
    ],
)
def test_the_world_is_as_fast_as_the_processors_carry_unless_told(
    robots: int, rtf: float | None, running: str | None, factor: float, said: str
) -> None:
    base = (
        Computer("aadiworkstation", "c", "running", "", {"REAL_TIME_FACTOR": running}, "i")
        if running
        else None
    )
    assert choose_factor(rtf, robots, 2.0, base) == (factor, said)


@pytest.mark.parametrize(
    ("rtf", "running", "pace"),
    [("lockstep", None, "lockstep"), (None, "lockstep", "lockstep"), (0.5, None, "0.5")],
)
def test_the_world_runs_in_lockstep_where_that_is_its_factor(
    rtf: float | str | None, running: str | None, pace: str
) -> None:
    base = (
        Computer("aadiworkstation", "c", "running", "", {"REAL_TIME_FACTOR": running}, "i")
        if running
        else None
    )
    assert choose_pace(rtf, 2, 2.0, base, False) == (pace, "")


@pytest.mark.parametrize(
    ("rtf", "running", "why"),
    [
        (None, "lockstep", "a fleet in lockstep takes no more robots"),
        (1.0, "lockstep", "the world that runs has a real-time factor of lockstep"),
        ("lockstep", "1", "the world that runs has a real-time factor of 1"),
    ],
)
def test_a_world_stays_in_lockstep_or_out_of_it_with_its_robots(
    rtf: float | str | None, running: str, why: str
) -> None:
    base = Computer("aadiworkstation", "c", "running", "", {"REAL_TIME_FACTOR": running}, "i")
    with pytest.raises(ContainerError, match=f"^{why}: ./pioneer down first$"):
        choose_pace(rtf, 3, 2.0, base, True)


@pytest.mark.parametrize(
    ("rtf", "running", "why"), [(-1.0, None, "0 .* or more"), (0.5, "1", "down first")]
)
def test_a_factor_that_cannot_be_is_refused(rtf: float, running: str | None, why: str) -> None:
    base = (
        Computer("aadiworkstation", "c", "running", "", {"REAL_TIME_FACTOR": running}, "i")
        if running
        else None
    )
    with pytest.raises(ContainerError, match=why):
        choose_factor(rtf, 5, 2.0, base)


COMPOSE = """#!/bin/bash
echo begin >>{journal}
sleep 2
echo end >>{journal}
"""


def test_a_call_waits_for_the_compose_of_one_that_was_killed(tmp_path: Path) -> None:
    """It continues without ./pioneer, and two at once would start the same containers."""
    compose, journal = tmp_path / "compose", tmp_path / "journal"
    journal.touch()
    compose.write_text(COMPOSE.format(journal=journal))
    compose.chmod(0o755)
    project = Project("test", (str(compose),), tmp_path / "file", {}, tmp_path / "lock")
    killed = os.fork()
    if killed == 0:
        project.run("up")
        os._exit(0)
    wait_until(lambda: "begin" in journal.read_text(), "the first call's Compose", 20.0)
    os.kill(killed, signal.SIGKILL)
    os.waitpid(killed, 0)
    project.run("up")
    assert journal.read_text().split() == ["begin", "end"] * 2
