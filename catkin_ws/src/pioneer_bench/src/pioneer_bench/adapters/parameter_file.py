"""move_base's parameters as its launch file loads them, without a parameter server."""

from pathlib import Path
from typing import Any

import rospkg
import yaml


def shipped_parameters() -> dict[str, Any]:
    """Returns the parameters of ``pioneer_2dnav`` as move_base finds them in its private namespace."""
    folder = Path(rospkg.RosPack().get_path("pioneer_2dnav")) / "config"

    def load(name: str) -> dict[str, Any]:
        return dict(yaml.safe_load((folder / f"{name}_params.yaml").read_text()))

    parameters = {**load("base_local_planner"), **load("dwa_local_planner")}
    for name in ("global_costmap", "local_costmap"):
        parameters[name] = {**load("costmap_common"), **load(name)[name]}
    return parameters
