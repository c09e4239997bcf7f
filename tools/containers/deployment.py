"""The swarm-specific part of ``./pioneer up``: its nodes, distribution of the image, and the stack."""

from argparse import Namespace
from collections.abc import Iterable, Sequence

from containers.engine import Computer, ContainerError, say
from containers.fleet_plan import DOWN, FleetPlan
from containers.layout import stack_text
from containers.registry import distribute
from containers.state import SHIPPED, certificates, project, secret, stack, write_whole
from containers.swarm import BASE_LABEL, awaited, check_engines, nodes

RUNNING, RUNNING_PER_ROBOT = 180.0, 10.0
"""Time-out for computers to run [s]: a node without the fleet's image pulls it first."""
REJECTIONS = 3
"""Number of times that a node may fail to start a computer before giving up: a busy registry answers the next time."""


def is_on_swarm(options: Namespace) -> bool:
    """Returns whether the fleet runs, or is to run, on a swarm.

    Raises:
        ContainerError: it runs on this machine alone, or the options do not fit together.
    """
    there = stack(options.project).file.is_file()
    if not (options.swarm or there):
        if options.update or options.registry:
            option = "update" if options.update else "registry"
            raise ContainerError(f"--{option} is for a fleet on a swarm: up --swarm")
        return False
    for extra in options.extras:
        raise ContainerError(
            f"--{extra} is for a fleet on one machine; on a swarm nothing is published"
        )
    if not there and project(options.project).computers():
        raise ContainerError(f"a fleet runs on this machine alone: {DOWN}")
    if options.update and not there:
        raise ContainerError("--update is for a fleet that runs; none does")
    return True


class Deployment:
    """A fleet on the swarm that this machine manages.

    Raises:
        ContainerError: this machine manages no swarm, or the engine of a node does not answer.
    """

    def __init__(self, options: Namespace) -> None:
        self.stack = stack(options.project)  #: the fleet's stack
        self._options = options
        found = nodes()
        self._manager, self._nodes = found[0], [one for one in found if one.works]
        check_engines(self._nodes)

    @property
    def processors(self) -> float:
        """Number of processors of all nodes that accept tasks."""
        return sum(one.processors for one in self._nodes)

    def image(self, plan: FleetPlan) -> str:
        """Returns the image's name in the swarm: the running fleet's, else one under which the nodes can pull it."""
        if plan.base and not self._options.update:
            return plan.base.image
        registry = self._options.registry
        if plan.base and not registry:
            used = plan.base.image.partition("/")[0]
            registry = "" if used.startswith(f"{self._manager.address}:") else used
        return distribute(registry, self._manager, self._nodes)

    def start(self, plan: FleetPlan, image: str) -> list[Computer]:
        """Starts missing computers, and replaces the robots' if requested; returns all of them, running.

        Raises:
            ContainerError: the swarm cannot run them; the text says why.
        """
        rejected = {one.task for one in self.stack.tasks()[1]}
        if plan.base is None:
            self._deploy(plan, image)
        else:
            if self._options.update:
                say(f"replacing {plan.robots} computers, one at a time")
                self.stack.update(image)
            self.stack.scale(plan.robots)
        self._await(plan, rejected)
        return self.stack.computers()

    def _deploy(self, plan: FleetPlan, image: str) -> None:
        base_on = (
            f"node.labels.{BASE_LABEL}==base"
            if any(one.base for one in self._nodes)
            else "node.role==manager"
        )
        write_whole(
            self.stack.file, stack_text(SHIPPED.read_text(), plan.robots, base_on, plan.factor)
        )
        self.stack.deploy(
            PIONEER_IMAGE=image,
            PIONEER_HUB_PASSWORD_FILE=str(secret("hub-password")),
            PIONEER_TLS_DIRECTORY=str(certificates()),
            **plan.variables,
        )

    def _await(self, plan: FleetPlan, rejected: set[str]) -> None:
        """Waits until every computer runs; ignores earlier failures, listed in ``rejected``."""
        seen: dict[str, Computer] = {}
        why = ""

        def settled() -> bool:
            nonlocal why
            there, failed = self.stack.tasks()
            seen.update({one.name: one for one in there})
            if len(seen) > plan.robots and all(one.running for one in seen.values()):
                return True
            why = _without_place(there) or _failing(
                [one for one in failed if one.task not in rejected]
            )
            return why != ""

        timeout = RUNNING + RUNNING_PER_ROBOT * plan.robots
        if not awaited(settled, timeout):
            late = [
                f"{one.name} ({one.problem or one.state})"
                for one in seen.values()
                if not one.running
            ]
            why = f"not running after {timeout:g} s: {', '.join(late)}"
        if why:
            raise ContainerError(f"{why}; ./pioneer status, {DOWN}")


def _without_place(computers: Iterable[Computer]) -> str:
    """Returns a message about the computers that the swarm cannot place; empty if there are none."""
    without = [
        one for one in computers if one.state == "pending" and "no suitable node" in one.problem
    ]
    names = ", ".join(one.name for one in sorted(without, key=lambda one: one.number))
    return f"the swarm has no place for {names}: {without[0].problem}" if without else ""


def _failing(rejected: Sequence[Computer]) -> str:
    """Returns a message about a computer that a node failed to start too often; empty if there is none."""
    for one in rejected:
        if sum(other.name == one.name for other in rejected) >= REJECTIONS:
            return f"{one.node} cannot start {one.name}: {one.problem}"
    return ""
