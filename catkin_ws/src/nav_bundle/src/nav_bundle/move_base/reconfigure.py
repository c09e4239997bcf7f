"""Run-time changes of move_base's parameters: dynamic_reconfigure in each of its namespaces."""

import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import rospy

from nav_bundle.costmap.footprint import FootprintError
from nav_bundle.move_base.config import Setup, changed_parameters, setup_from_parameters
from pioneer_node.core.live import Value
from pioneer_node.core.parameter import ParameterError
from pioneer_node.nodes.reconfigure import ReconfigureServer


class Reconfiguration:
    """Serves ``set_parameters`` for the node, its planners, costmaps and layers.

    A change rebuilds the setup from all parameters, with the same checks as at start.

    Publishes, Services: those of ``ReconfigureServer`` under ``~``, ``~<local planner>``, ``~GlobalPlanner`` if that
        planner is used, ``~<costmap>`` and ``~<costmap>/<layer>``.

    Threads: ``adopt`` is called in a service thread, one call at a time.

    On error: an invalid change is rejected with one line, and nothing changes.

    Args:
        parameters: the node's private parameters, from which ``setup`` was built.
        setup: the current setup.
        adopt: applies a new setup.
    """

    def __init__(
        self, parameters: Mapping[str, Any], setup: Setup, adopt: Callable[[Setup], None]
    ) -> None:
        self._parameters, self._setup, self._adopt = parameters, setup, adopt
        self._turn = threading.Lock()
        self._servers: dict[str, ReconfigureServer] = {}
        self._serve()

    def _serve(self) -> None:
        configs = self._setup.live_configs()
        for namespace in self._servers.keys() - configs.keys():
            self._servers.pop(namespace).close()
        for namespace, config in configs.items():
            if namespace in self._servers:
                self._servers[namespace].update(config)
            else:
                apply = partial(self._apply, namespace)
                self._servers[namespace] = ReconfigureServer(
                    f"~{namespace}", config, apply, _BAD_INPUT
                )

    def _apply(self, namespace: str, changes: dict[str, Value]) -> None:
        with self._turn:
            parameters = changed_parameters(self._parameters, self._setup, namespace, changes)
            setup = setup_from_parameters(parameters, rospy.get_name())
            self._adopt(setup)
            self._parameters, self._setup = parameters, setup
            self._serve()


_BAD_INPUT = (ParameterError, FootprintError)


def outline_parameters() -> dict[str, Any]:
    """Returns the robot's outline from the namespaces around the node: costmap_2d searches it upwards."""
    found = {}
    for name in ("footprint", "robot_radius"):
        key = rospy.search_param(name)
        if key:
            found[name] = rospy.get_param(key)
    return found
