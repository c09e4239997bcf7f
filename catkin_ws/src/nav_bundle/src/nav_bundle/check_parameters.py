"""Finds names of parameters that the navigation nodes do not know, before the nodes run."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import rospkg
import yaml

from nav_bundle.base.error import NavigationError
from nav_bundle.costmap.config import NAMES as COSTMAP_NAMES
from nav_bundle.localisation.config import UNSUPPORTED, AmclConfig
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.move_base.config import MoveBaseConfig, setup_from_parameters
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


_NODES = ("move_base", "amcl", "slam_gmapping")
_COSTMAPS = ("move_base/global_costmap", "move_base/local_costmap")
_NAMESPACES = {
    "global_costmap", "local_costmap", "TrajectoryPlannerROS", "DWAPlannerROS", "NavfnROS", "GlobalPlanner",
}  # fmt: skip
"""Namespaces in that of move_base, which tell what a file is for."""


def namespaces_of(content: Any) -> tuple[str, ...]:
    """Returns the namespaces into which launch files load a parameter file with this content.

    A robot's namespace is empty, as for a file with ``move_base:`` or ``amcl:``. Parameters that both costmaps have in
    common go into two. There is no namespace for content that is for none of the navigation nodes.
    """
    if not isinstance(content, Mapping):
        return ()
    names = {str(name).strip("/").split("/")[0] for name in content}
    if names & set(_NODES):
        return ("",)
    known: dict[tuple[str, ...], set[str]] = {
        ("move_base",): {field.name for field in fields(MoveBaseConfig)} | _NAMESPACES,
        _COSTMAPS: set(COSTMAP_NAMES),
        ("amcl",): {field.name for field in fields(AmclConfig)},
        ("slam_gmapping",): {field.name for field in fields(GmappingConfig)},
    }
    if names & _NAMESPACES or any(name.endswith("PlannerROS") for name in names):
        return ("move_base",)
    best = max(known, key=lambda namespaces: len(names & known[namespaces]))
    return best if names & known[best] else ()


def flattened(namespace: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a file's parameters by their names in the robot's namespace, when they are loaded into ``namespace``."""
    found: dict[str, Any] = {}
    _flatten(namespace, values, found)
    return {name.strip("/"): value for name, value in found.items()}


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


def read_as_nodes_do(parameters: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Returns what ends a node that has these parameters, and the warnings that nodes log.

    Args:
        parameters: by name in the robot's namespace; those of other nodes are left out.
    """
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        _put(tree, name.strip("/").split("/"), value)
    refused = []
    with UNKNOWN.noted() as warnings:
        for node, own in tree.items():
            try:
                _read(node, own)
            except (ParameterError, NavigationError) as error:
                refused.append(str(error))
    return refused, warnings


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
