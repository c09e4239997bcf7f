"""pybullet's own viewer."""

import os
import socket

from pioneer_gazebo.adapters.quiet_pybullet import pybullet
from pioneer_gazebo.core.engine import EngineError


def client_with_window() -> int:
    """Returns a pybullet physics client with a viewer.

    Raises:
        EngineError: the display does not respond. This is checked first, as pybullet would end the whole process.
    """
    name = os.environ.get("DISPLAY", "")
    if not display_answers(name):
        raise EngineError(f"gui: a window needs a display, and none answers at DISPLAY={name!r}")
    client = pybullet.connect(pybullet.GUI)
    if client < 0:
        raise EngineError(f"gui: pybullet cannot open its window at {name}; does the display support OpenGL 3?")
    for option in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_KEYBOARD_SHORTCUTS):
        pybullet.configureDebugVisualizer(option, 0, physicsClientId=client)
    pybullet.resetDebugVisualizerCamera(12.0, 0.0, -60.0, (0.0, 0.0, 0.0), physicsClientId=client)
    return client


def display_answers(name: str) -> bool:
    """Returns whether an X server listens at ``name`` (``:0``, ``host:10.0``)."""
    host, colon, rest = name.rpartition(":")
    number = rest.partition(".")[0]
    if not (colon and number.isdigit()):
        return False
    try:
        if host in ("", "unix"):
            with socket.socket(socket.AF_UNIX) as local:
                local.connect(f"/tmp/.X11-unix/X{number}")
        else:
            socket.create_connection((host, 6000 + int(number)), timeout=2.0).close()
    except OSError:
        return False
    return True
