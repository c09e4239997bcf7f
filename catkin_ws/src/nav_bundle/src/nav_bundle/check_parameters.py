"""Finds names of parameters that the navigation nodes do not know, before the nodes run."""

from collections.abc import Mapping
from typing import Any

from nav_bundle.base.error import NavigationError
from nav_bundle.localisation.config import UNSUPPORTED, AmclConfig
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.move_base.config import setup_from_parameters
from pioneer_node.core.parameter import UNKNOWN, ParameterError, config_from_mapping


def faults(parameters: Mapping[str, Any]) -> list[str]:
    """Returns what is wrong with parameters of a robot's navigation nodes: unknown names and refused values.

    Parameters in the namespace of a planner that is not selected are not read, as in the nodes.

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
