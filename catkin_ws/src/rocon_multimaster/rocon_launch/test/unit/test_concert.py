"""A .concert file becomes launches; any error in it is reported in one line."""

from collections.abc import Mapping

import pytest

from rocon_launch.concert import Launch, launches_from_text
from rocon_launch.error import ConcertError

CONCERT = """
<concert>
  <arg name="port" default="6380"/>
  <arg name="name" value="Pioneer Hub"/>
  <launch title="hub" package="pioneer_networking" name="pioneer_hub.launch" port="11311">
    <arg name="hub_port" value="$(arg port)"/>
  </launch>
  <launch package="pioneer_networking" name="pioneer_gateway.launch" port="11312"/>
  <launch name="/tmp/more.launch" port="11312"/>
  <launch name="/tmp/default.launch"/>
</concert>
"""


def substituted(text: str, arguments: Mapping[str, str]) -> str:
    for name, value in arguments.items():
        text = text.replace(f"$(arg {name})", value)
    return text


def launches(text: str, **mappings: str) -> list[Launch]:
    return launches_from_text(text, mappings, 11400, substituted)


def test_each_launch_has_its_port_title_and_arguments() -> None:
    hub, gateway, more, default = launches(CONCERT)
    assert hub == Launch(
        "pioneer_networking", "pioneer_hub.launch", 11311, "hub", {"hub_port": "6380"}
    )
    assert (gateway.title, gateway.waits, more.waits) == ("rocon_launch:11312", False, True)
    assert default.port == 11400


def test_the_command_line_goes_before_default_and_value() -> None:
    assert launches(CONCERT, port="7000", name="x")[0].arguments == {"hub_port": "7000"}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("<concert>", "not XML"),
        ("<launch/>", "the root is <launch>"),
        ("<concert><node/></concert>", "neither <arg> nor <launch>"),
        ('<concert><arg name="a"/></concert>', "exactly one of default and value"),
        (
            '<concert><arg name="a" default="1" value="2"/></concert>',
            "exactly one of default and value",
        ),
        ("<concert><launch/></concert>", "has no name"),
        ('<concert><launch name="a" port="x"/></concert>', "is not a port"),
        ('<concert><launch name="a" port="70000"/></concert>', "is not a port"),
        (
            '<concert><launch name="a"><arg name="b" default="1"/></launch></concert>',
            "may hold only",
        ),
        (
            '<concert><launch name="a" respawn="yes"/></concert>',
            "respawn must be true or false, not 'yes'",
        ),
        ('<concert><launch name="a" respawn="true" required="true"/></concert>', "cannot be both"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(text: str, what: str) -> None:
    with pytest.raises(ConcertError, match=what):
        launches(text)


def test_an_argument_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(ConcertError, match="no argument 'prot'; there are name, port"):
        launches(CONCERT, prot="1")


@pytest.mark.parametrize(
    ("attribute", "lived", "again", "all_end"),
    [
        ("", 3600.0, False, False),
        ("", 0.0, False, False),
        ('required="true"', 3600.0, False, True),
        ('respawn="true"', 3600.0, True, False),
        ('respawn="true"', 1.0, False, True),
        ('respawn="false" required="false"', 1.0, False, False),
    ],
)
def test_what_the_end_of_a_launch_means(
    attribute: str, lived: float, again: bool, all_end: bool
) -> None:
    (launch,) = launches(f'<concert><launch name="a" {attribute}/></concert>')
    assert (launch.starts_again(lived), launch.ends_all(lived)) == (again, all_end)
