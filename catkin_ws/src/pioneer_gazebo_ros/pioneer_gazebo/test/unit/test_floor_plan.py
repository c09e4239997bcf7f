import pytest

from pioneer_gazebo.commands.floor_plan import plan_from_text, world_of_plan
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.model import Box, Cylinder
from pioneer_gazebo.world.sdf import GROUND_PLANE

DRAWING = """
# two rooms
cell: 2.0
x: 1.0
y: -1.0
thickness: 0.1
height: 0.5
---
+---+---+
| o |
+   +---+
|     # |
+---+---+
"""


def solids(text):
    world = world_of_plan(plan_from_text(text), "rooms", GROUND_PLANE)
    return [
        (c.collision.shape, c.pose.position) for c in world.collisions() if c.model.name == "walls"
    ]


def test_walls_in_one_line_are_one_box():
    found = solids(DRAWING)
    assert (Box((4.1, 0.1, 0.5)), (3.0, 3.0, 0.25)) in found
    assert (Box((0.1, 4.1, 0.5)), (1.0, 1.0, 0.25)) in found
    assert (Box((2.1, 0.1, 0.5)), (4.0, 1.0, 0.25)) in found


def test_pillars_and_solid_cells_stand_in_the_middle_of_their_cells():
    found = solids(DRAWING)
    assert (Cylinder(0.2, 0.5), (2.0, 2.0, 0.25)) in found
    assert (Box((2.0, 2.0, 0.5)), (4.0, 0.0, 0.25)) in found
    assert len(found) == 8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cell: 1\n", "a line --- must stand"),
        ("cells: 1\n---\n+---+\n|   |\n+---+", "line 1: 'cells' is not one of cell, x"),
        ("cell: one\n---\n+---+\n|   |\n+---+", "'one' is not a number"),
        ("---\n", "no cell"),
    ],
)
def test_bad_plan_is_refused(text, message):
    with pytest.raises(DescriptionError, match=message):
        plan_from_text(text, "some.plan")
