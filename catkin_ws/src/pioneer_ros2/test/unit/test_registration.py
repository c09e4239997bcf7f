"""The door notices a restarted master, whatever reaches the new one from before."""

import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from pioneer_ros2.node import DoorNode

DOOR = "/ros2_door"
AT_START = [["/ros2_door/topics", [DOOR]], ["/diagnostics", [DOOR]]]
"""What the master lists as published."""


class Door:
    """What the door's look at the master uses; counts how often it registers again."""

    def __init__(self) -> None:
        self.again = 0
        node = SimpleNamespace(
            name=DOOR,
            resolved=lambda name: name.replace("~", f"{DOOR}/"),
            register_again=self._register_again,
            logger=logging.getLogger("door"),
        )
        self._self = SimpleNamespace(_node=node, _was_registered=False, _is_held_kept=True)

    def _register_again(self) -> None:
        self.again += 1

    def look(self, *published: list[object]) -> None:
        DoorNode._check_registration(self._self, published)  # type: ignore[arg-type]


def test_a_door_that_the_master_has_forgotten_registers_again() -> None:
    door = Door()
    door.look()
    door.look(*AT_START)
    assert door.again == 0
    door.look(["/odom", ["/robot"]])
    assert door.again == 1


def test_a_topic_that_reaches_a_new_master_is_no_sign_that_it_knows_the_door() -> None:
    """A velocity that was advertised while the master was restarted was all that the new one ever knew of the door."""
    door = Door()
    door.look(*AT_START)
    door.look(["/pioneer1/pioneer/cmd_vel", [DOOR]])
    assert door.again == 1
    door.look(["/pioneer1/pioneer/cmd_vel", [DOOR]], *AT_START)
    assert door.again == 1


class Holds:
    """The part of a door that stores what it holds; its master answers or fails as ``fails`` says."""

    def __init__(self) -> None:
        self.fails = False
        self.stored: list[object] = []
        door = DoorNode.__new__(DoorNode)
        door._system_state, door._looks = [[], [], []], 0
        door._held, door._is_held_kept = [], True
        door._node = SimpleNamespace(name=DOOR, resolved=lambda _: f"{DOOR}/held")  # type: ignore[assignment]
        door._master = SimpleNamespace(call=self._call)  # type: ignore[assignment]
        door._apply = door._mute_held = lambda: None  # type: ignore[method-assign]
        self.door = door

    def _call(
        self,
        _method: str,
        arguments: tuple[Any, ...],
        done: Callable[[Any], None],
        failed: Callable[[str], None],
    ) -> None:
        if self.fails:
            failed("refused")
        else:
            self.stored.append(arguments[2])
            done(0)

    def look(self) -> None:
        self.door._take_state([[], [], []])


def test_a_hold_is_stored_until_the_master_has_it_and_at_a_restarted_one() -> None:
    """The node that took the place of a killed door held nothing: the one failed call was not repeated."""
    holds = Holds()
    holds.fails = True
    holds.door._keep_held(["pioneer1"])
    holds.look()
    assert holds.stored == []
    holds.fails = False
    holds.look()
    holds.look()
    assert holds.stored == [["pioneer1"]]
    holds.door._was_registered = True
    holds.door._node.resolved = lambda name: name.replace("~", f"{DOOR}/")  # type: ignore[method-assign]
    holds.door._node.logger = logging.getLogger("door")  # type: ignore[assignment]
    holds.door._node.register_again = lambda: None  # type: ignore[method-assign]
    holds.door._check_registration([])
    holds.look()
    assert holds.stored == [["pioneer1"]] * 2
