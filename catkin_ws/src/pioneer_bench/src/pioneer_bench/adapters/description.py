"""The Pioneer's description, as shipped and with meshes as in the original."""

import math
import subprocess
from dataclasses import replace
from pathlib import Path

import rospkg

from pioneer_gazebo.world.model import Collision, Mesh
from pioneer_gazebo.world.pose import IDENTITY
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.urdf import robot_from_urdf


def pioneer_urdf(**arguments: object) -> str:
    """Returns the Pioneer's URDF, expanded by xacro with ``arguments``."""
    xacro = Path(rospkg.RosPack().get_path("pioneer_description")) / "urdf" / "pioneer3dx.xacro"
    command = ["xacro", str(xacro), *(f"{name}:={value}" for name, value in arguments.items())]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


DRUMS = {
    **{f"{side}_wheel": (0.0975, 0.04) for side in ("left", "right")},
    **{f"{side}_hub": (0.055, 0.044) for side in ("left", "right")},
    "center_wheel": (0.0375, 0.025),
    "center_hubcap": (0.018, 0.028),
}
"""Radius and width [m] of the parts that are meshes in the original's description."""

SIDES = 24


def meshed_pioneer(folder: Path) -> Robot:
    """Returns the Pioneer with a camera and with mesh wheels and hubcaps; writes the meshes to ``folder``."""
    robot = robot_from_urdf(pioneer_urdf(camera=True))
    links = []
    for link in robot.links:
        if link.name in DRUMS:
            path = folder / f"{link.name}.obj"
            path.write_text(_drum(*DRUMS[link.name]))
            mesh = Collision(
                "mesh",
                IDENTITY,
                Mesh(str(path)),
                link.collisions[0].friction if link.collisions else 1.0,
            )
            link = replace(link, collisions=(mesh,))
        links.append(link)
    return replace(robot, links=tuple(links))


def _drum(radius: float, width: float) -> str:
    """Returns a prism along the y axis, in OBJ format."""
    rim = [
        (radius * math.cos(a), radius * math.sin(a))
        for a in (k * math.tau / SIDES for k in range(SIDES))
    ]
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for y in (-width / 2, width / 2) for x, z in rim]
    quads = [(k + 1, (k + 1) % SIDES + 1) for k in range(SIDES)]
    lines += [f"f {a} {b} {b + SIDES} {a + SIDES}" for a, b in quads]
    lines += [f"f {' '.join(map(str, range(first, first + SIDES)))}" for first in (1, SIDES + 1)]
    return "\n".join(lines) + "\n"
