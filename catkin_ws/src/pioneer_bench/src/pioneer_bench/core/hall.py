"""The hall that robots drive in while the simulator is measured: 20 × 20 m with walls of boxes."""

import math
import random

SIDE = 20.0
"""Inner side of the hall [m]."""

WALLS = 53
"""Boxes in all, the four outer walls among them."""

SPACING = 2.5
"""Between the places where robots start [m]."""

_BOX = """    <model name="wall_{number}">
      <static>true</static>
      <pose>{x:.3f} {y:.3f} 0.5 0 0 {yaw:.4f}</pose>
      <link name="link">
        <collision name="collision"><geometry><box><size>{length:.3f} 0.1 1.0</size></box></geometry></collision>
      </link>
    </model>
"""

_WORLD = """<?xml version="1.0"?>
<sdf version="1.6">
  <world name="hall">
    <include><uri>model://ground_plane</uri></include>
{boxes}  </world>
</sdf>
"""


def starts() -> list[tuple[float, float]]:
    """Returns the places [m] where robots may start: the middles of squares that no inner wall enters."""
    count = int(SIDE / SPACING)
    first = -SIDE / 2 + SPACING / 2
    return [(first + column * SPACING, first + row * SPACING) for row in range(count) for column in range(count)]


def world(seed: int) -> str:
    """Returns the hall as SDF: inner walls on the lines between the starts, drawn from ``seed``."""
    half = SIDE / 2 + 0.05
    boxes = [
        _BOX.format(number=number, x=x, y=y, yaw=yaw, length=SIDE + 0.2)
        for number, (x, y, yaw) in enumerate(
            [(half, 0, math.pi / 2), (-half, 0, math.pi / 2), (0, half, 0), (0, -half, 0)]
        )
    ]
    lines = int(SIDE / SPACING) - 1
    sites = [(line, place, turned) for line in range(lines) for place in range(lines + 1) for turned in (False, True)]
    for number, (line, place, turned) in enumerate(random.Random(seed).sample(sites, WALLS - 4), start=4):
        across = -SIDE / 2 + (line + 1) * SPACING
        along = -SIDE / 2 + (place + 0.5) * SPACING
        x, y, yaw = (across, along, math.pi / 2) if turned else (along, across, 0.0)
        boxes.append(_BOX.format(number=number, x=x, y=y, yaw=yaw, length=1.2))
    return _WORLD.format(boxes="".join(boxes))
