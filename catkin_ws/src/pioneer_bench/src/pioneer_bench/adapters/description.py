"""The Pioneer as the workspace describes it."""

import subprocess
from pathlib import Path

import rospkg


def pioneer_urdf(**arguments: object) -> str:
    """Returns the Pioneer's URDF, by xacro with ``arguments``."""
    xacro = Path(rospkg.RosPack().get_path("pioneer_description")) / "urdf" / "pioneer3dx.xacro"
    command = ["xacro", str(xacro), *(f"{name}:={value}" for name, value in arguments.items())]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
