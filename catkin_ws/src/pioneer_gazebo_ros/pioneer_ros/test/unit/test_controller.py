"""Commands are scaled, invalid ones are rejected, and a timeout after movement is detected once."""

import io
import math

import pytest
from geometry_msgs.msg import Twist, Vector3

from pioneer_node.core.parameter import ParameterError
from pioneer_ros.conversions import CommandMessage
from pioneer_ros.core.controller import ZERO, CommandError, Gains, Watchdog, gains_from_parameters


def test_each_part_is_scaled_by_its_gain() -> None:
    assert Gains(2.0, 0.5).scaled((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)) == (2.0, 4.0, 6.0, 2.0, 2.5, 3.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(6))
def test_a_command_that_is_not_finite_is_refused(place: int, bad: float) -> None:
    command = [0.0] * 6
    command[place] = bad
    with pytest.raises(CommandError, match="not finite"):
        Gains().scaled(tuple(command))


def test_two_infinities_of_opposite_sign_do_not_cancel() -> None:
    with pytest.raises(CommandError):
        Gains().scaled((math.inf, -math.inf, 0.0, 0.0, 0.0, 0.0))


def test_gains_are_read_from_their_names() -> None:
    parameters = {
        "controller_gains": {"body": {"linear": {"p": 2}, "angular": {"p": 0.5, "i": 0.0, "d": 0}}}
    }
    assert gains_from_parameters(parameters, "/pioneer_ros") == Gains(2.0, 0.5)
    assert gains_from_parameters({}, "/pioneer_ros") == Gains(1.0, 1.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"controller_gains": {"body": {"linear": 1.0}}}, "must hold a gain p"),
        ({"controller_gains": {"body": {"linear": {"p": "big"}}}}, "finite number"),
        ({"controller_gains": {"body": {"linear": {"p": math.nan}}}}, "finite number"),
    ],
)
def test_a_parameter_that_is_wrong_is_named(parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        gains_from_parameters(parameters, "/pioneer_ros")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"controller_gain": {}},
            "unknown parameter ~controller_gain; did you mean ~controller_gains?",
        ),
        (
            {"controller_gains": {"left": {"p": 1.0}, "body": {"linear": {"p": 2.0}}}},
            "~controller_gains/left. It has",
        ),
        (
            {"controller_gains": {"body": {"lateral": {}}}},
            "unknown parameter ~controller_gains/body/lateral",
        ),
        (
            {"controller_gains": {"body": {"linear": {"gain": 1.0}}}},
            "~controller_gains/body/linear/gain",
        ),
        (
            {"controller_gains": {"body": {"linear": {"p": 2.0, "i": 0.2}}}},
            "~controller_gains/body/linear/i",
        ),
    ],
)
def test_gains_that_nothing_reads_are_warnings(
    parameters: dict[str, object], message: str, caplog: pytest.LogCaptureFixture
) -> None:
    linear = gains_from_parameters(parameters, f"/{message}").linear
    assert linear == (2.0 if "2.0" in str(parameters) else 1.0)
    assert message in caplog.text


def test_silence_after_movement_is_noticed_once() -> None:
    watchdog = Watchdog(0.5)
    watchdog.command(True, 10.0)
    assert not watchdog.expired(10.5)
    assert watchdog.expired(10.6)
    assert not watchdog.expired(20.0)


def test_silence_after_a_stop_is_no_matter() -> None:
    watchdog = Watchdog(0.5)
    watchdog.command(True, 10.0)
    watchdog.command(False, 10.1)
    assert not watchdog.armed
    assert not watchdog.expired(20.0)


def test_a_jump_back_in_time_does_not_silence_the_watchdog() -> None:
    watchdog = Watchdog(0.5)
    watchdog.command(True, 100.0)
    assert not watchdog.expired(1.0)
    assert watchdog.expired(1.6)


def test_a_command_message_has_the_bytes_of_a_twist() -> None:
    command = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    ours, theirs = io.BytesIO(), io.BytesIO()
    CommandMessage(command).serialize(ours)
    Twist(Vector3(*command[:3]), Vector3(*command[3:])).serialize(theirs)
    assert ours.getvalue() == theirs.getvalue()
    assert CommandMessage().deserialize(theirs.getvalue()).command == command
    assert CommandMessage().command == ZERO
    assert CommandMessage._md5sum == Twist._md5sum
