"""Finds names of parameters that the navigation nodes do not know, before the nodes run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rospkg
import yaml

from nav_bundle.base.error import NavigationError
from nav_bundle.localisation.config import UNSUPPORTED, AmclConfig
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.move_base.config import setup_from_parameters
from pioneer_node.core.parameter import UNKNOWN, ParameterError, config_from_mapping

_SHIPPED = {
    "costmap_common_params.yaml": ("global_costmap", "local_costmap"),
    "global_costmap_params.yaml": ("",),
    "local_costmap_params.yaml": ("",),
    "base_local_planner_params.yaml": ("",),
    "dwa_local_planner_params.yaml": ("",),
}
"""move_base's parameter files of a robot, and the namespaces into which its launch file loads each."""


def shipped_parameters() -> dict[str, Any]:
    """Returns the parameters that robots have from ``pioneer_2dnav``, by name in the robot's namespace.

    There are none without that package.
    """
    try:
        folder = Path(rospkg.RosPack().get_path("pioneer_2dnav")) / "config"
    except rospkg.ResourceNotFound:
        return {}
    found: dict[str, Any] = {}
    for name, namespaces in _SHIPPED.items():
        values = yaml.safe_load((folder / name).read_text())
        for namespace in namespaces:
            _flatten(f"move_base/{namespace}".rstrip("/"), values, found)
    return found


def _flatten(namespace: str, values: Mapping[str, Any], found: dict[str, Any]) -> None:
    """Adds nested values to those found, by their whole names."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            _flatten(f"{namespace}/{name}", value, found)
        else:
            found[f"{namespace}/{name}"] = value


def faults(parameters: Mapping[str, Any]) -> list[str]:
    """Returns what is wrong with a robot's parameters of the navigation nodes: unknown names and refused values.

    Give all parameters that the nodes will have: some values are refused because of others. Parameters in the
    namespace of a planner that is not selected are not read, as in the nodes.

    Args:
        parameters: by name in the robot's namespace, such as ``move_base/local_costmap/width``; those of other nodes
            are left out.
    """
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        _put(tree, name.strip("/").split("/"), value)
    with UNKNOWN.collected() as found:
        for node, own in tree.items():
            try:
                _read(node, own)
            except (ParameterError, NavigationError) as error:
                found.append(str(error))
    return found


def _put(tree: dict[str, Any], names: list[str], value: Any) -> None:
    """Puts a value into nested namespaces; a namespace takes the place of a value with its name."""
    *namespaces, last = names
    for namespace in namespaces:
        found = tree.get(namespace)
        tree[namespace] = dict(found) if isinstance(found, Mapping) else {}
        tree = tree[namespace]
    tree[last] = value


def _read(node: str, parameters: Any) -> None:
    """Reads a node's parameters as the node does."""
    if not isinstance(parameters, Mapping):
        return
    if node == "move_base":
        setup_from_parameters(parameters, node)
    elif node == "amcl":
        config_from_mapping(AmclConfig, parameters, node, ignored=UNSUPPORTED)
    elif node == "slam_gmapping":
        config_from_mapping(GmappingConfig, parameters, node)
