"""Scales velocity commands, and detects when their source stops sending."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pioneer_node.core.parameter import UNKNOWN, ParameterError

Command = tuple[float, float, float, float, float, float]
"""A velocity: linear x, y, z [m/s], angular x, y, z [rad/s], in the robot's frame."""

ZERO: Command = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class CommandError(ValueError):
    """A command is not finite."""


@dataclass(frozen=True)
class Gains:
    """Factors from commanded to forwarded velocity."""

    linear: float = 1.0  #: for linear velocity
    angular: float = 1.0  #: for angular velocity

    def scaled(self, command: Command) -> Command:
        """Returns ``command`` scaled by the gains.

        Raises:
            CommandError: a component of the command or of the result is not finite.
        """
        x, y, z, roll, pitch, yaw = command
        linear, angular = self.linear, self.angular
        result = (
            linear * x,
            linear * y,
            linear * z,
            angular * roll,
            angular * pitch,
            angular * yaw,
        )
        if not math.isfinite(sum(abs(part) for part in result)):
            raise CommandError(f"velocity {command} is not finite")
        return result


def gains_from_parameters(parameters: Mapping[str, Any], owner: str) -> Gains:
    """Returns the gains in ``controller_gains/body/{linear,angular}/p``, each 1 by default.

    Integral and derivative gains (``i``, ``d``) have no effect: the robot's own drive closes the loop.

    Raises:
        ParameterError: a gain is not a finite number.
    """
    gains = _inner(
        _inner(parameters, "controller_gains", "", owner), "body", "controller_gains/", owner
    )
    parts = {"linear": 1.0, "angular": 1.0}
    for name in gains:
        if name not in parts:
            UNKNOWN.report(owner, name, parts, "controller_gains/body/")
        else:
            parts[name] = _proportional(gains[name], f"controller_gains/body/{name}", owner)
    return Gains(**parts)


def _inner(mapping: Mapping[str, Any], name: str, above: str, owner: str) -> Mapping[str, Any]:
    for other in mapping:
        if other != name:
            UNKNOWN.report(owner, other, [name], above)
    inner = mapping.get(name, {})
    if not isinstance(inner, Mapping):
        raise ParameterError(f"{owner}: parameter ~{above}{name} must hold names, not {inner!r}")
    return inner


def _proportional(values: Any, where: str, owner: str) -> float:
    if not isinstance(values, Mapping):
        raise ParameterError(f"{owner}: parameter ~{where} must hold a gain p, not {values!r}")
    for name, value in values.items():
        if name in ("i", "d") and value == 0:
            continue
        if name != "p":
            UNKNOWN.report(owner, name, ["p"], f"{where}/")
        elif (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise ParameterError(
                f"{owner}: parameter ~{where}/{name} must be a finite number, not {value!r}"
            )
    return float(values.get("p", 1.0))


class Watchdog:
    """Detects that a source stopped sending while the robot moves. Not thread-safe.

    Args:
        timeout: longest permitted silence [s of ROS time].
    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self._last: float | None = None

    @property
    def armed(self) -> bool:
        """Whether the last command moves the robot, so that silence must be detected."""
        return self._last is not None

    def command(self, moving: bool, now: float) -> None:
        """Records a command at ROS time ``now`` [s]."""
        self._last = now if moving else None

    def expired(self, now: float) -> bool:
        """Returns, only once, whether the timeout has passed at ROS time ``now`` [s].

        If time has jumped back, the timeout counts from the new time.
        """
        if self._last is None:
            return False
        if now < self._last:
            self._last = now
        if now - self._last <= self.timeout:
            return False
        self._last = None
        return True
