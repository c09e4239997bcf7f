"""The door notices a restarted master, whatever reaches the new one from before."""

import logging
from types import SimpleNamespace

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
        self._self = SimpleNamespace(_node=node, _was_registered=False)

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
