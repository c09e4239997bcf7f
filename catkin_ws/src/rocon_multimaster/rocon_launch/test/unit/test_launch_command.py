"""The files that the command finds, and its error for a file that does not exist."""

from pathlib import Path

import pytest

from rocon_launch import command
from rocon_launch.concert import Launch
from rocon_launch.error import ConcertError


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[Launch], bool]]:
    """Returns the recorded launches, each with whether its output is shown; nothing is actually started."""
    runs: list[tuple[list[Launch], bool]] = []

    class Runner:
        def __init__(self, launches: list[Launch], screen: bool, _program: str) -> None:
            runs.append((launches, screen))

        def run(self) -> int:
            return 0

    monkeypatch.setattr(command, "ConcertRunner", Runner)
    return runs


@pytest.fixture
def concert(tmp_path: Path) -> Path:
    (tmp_path / "a.launch").write_text("<launch/>")
    path = tmp_path / "some.concert"
    path.write_text(
        f'<concert><arg name="port" default="12000"/><launch name="{tmp_path}/a.launch" port="$(arg port)"/>'
        f'<launch name="{tmp_path}/a.launch" title="$(optenv WHO nobody)"/></concert>'
    )
    return path


def test_a_file_is_run_with_arguments_and_substitutions(concert, started, monkeypatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://here:11555/")
    monkeypatch.setenv("WHO", "me")
    assert command.main([str(concert), "port:=12345", "--screen"]) == 0
    (((first, second), screen),) = started
    assert (first.port, second.port, second.title, screen) == (12345, 11555, "me", True)


def test_a_file_of_a_package_is_found(started) -> None:
    assert command.main(["pioneer_networking", "hubgate.concert"]) == 0
    assert {one.package for one in started[0][0]} == {"pioneer_networking"}


@pytest.mark.parametrize("uri", ["", "http://here"])
def test_without_a_port_in_the_masters_address_it_is_11311(
    concert, started, monkeypatch, uri
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    command.main([str(concert)])
    assert started[0][0][1].port == 11311


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["/no/such.concert"], "there is no file /no/such.concert; usage: rocon_launch"),
        (["no_such_package", "a.concert"], "there is no package 'no_such_package'"),
        (
            ["pioneer_networking", "no.concert"],
            "package 'pioneer_networking' has no file 'no.concert'",
        ),
        (["one", "two", "three"], "too many names; usage: rocon_launch"),
    ],
)
def test_what_is_missing_is_one_line(started, capsys, words, said) -> None:
    assert command.main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"rocon_launch: {said}")
    assert error.count("\n") == 1
    assert started == []


@pytest.mark.parametrize(
    ("launch", "said"),
    [
        ('<launch name="/no/such.launch"/>', "there is no launch file /no/such.launch"),
        ('<launch package="rospy" name="no.launch"/>', "package 'rospy' has no file 'no.launch'"),
        ('<launch name="$(arg robots)"/>', "'$(arg robots)':"),
        (
            '<launch name="$(find no_such_package)/a.launch"/>',
            "there is no package no_such_package",
        ),
    ],
)
def test_nothing_starts_if_a_launch_file_is_missing(
    tmp_path, started, capsys, launch, said
) -> None:
    path = tmp_path / "some.concert"
    path.write_text(f"<concert>{launch}</concert>")
    assert command.main([str(path)]) == 1
    assert said in capsys.readouterr().err
    assert started == []


def test_an_unknown_argument_is_refused(concert, started, capsys) -> None:
    assert command.main([str(concert), "prot:=1"]) == 1
    assert "there is no argument 'prot'; there are port" in capsys.readouterr().err


def test_substitutions_know_the_arguments() -> None:
    assert command._substituted("$(arg a)-$(optenv NO_SUCH_VARIABLE b)", {"a": "1"}) == "1-b"
    with pytest.raises(ConcertError):
        command._substituted("$(env NO_SUCH_VARIABLE)", {})
