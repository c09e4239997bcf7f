"""slam_gmapping's parameters, with the names and defaults of ROS Noetic."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

from pioneer_node.core.parameter import ParameterError, WithoutEffect

_POSITIVE = ("sigma", "lsigma", "lstep", "astep", "ogain", "delta")
_NOT_NEGATIVE = (
    "kernelSize", "iterations", "lskip", "srr", "srt", "str", "stt",
    "resampleThreshold", "transform_publish_period", "tf_delay", "seed", "minimumScore",
)  # fmt: skip

_NEVER_SAMPLED = WithoutEffect("is for a likelihood that is never sampled, as in Noetic")


@dataclass(frozen=True)
class GmappingConfig:
    """Parameters of slam_gmapping in SI units; config/gmapping_defaults.yaml documents each one.

    A negative ``maxUrange``, ``maxRange`` or ``tf_delay`` selects Noetic's default for an unset parameter. With
    ``linearUpdate`` or ``angularUpdate`` of 0 or less every scan is processed, and with ``map_update_interval`` of 0 or
    less every processed scan updates the map.

    Raises:
        ParameterError: a value is out of range.
    """

    base_frame: str = "base_link"
    map_frame: str = "map"
    odom_frame: str = "odom"
    throttle_scans: int = 1
    transform_publish_period: float = 0.05
    tf_delay: float = -1.0
    map_update_interval: float = 5.0
    occ_thresh: float = 0.25
    maxUrange: float = -1.0
    maxRange: float = -1.0
    sigma: float = 0.05
    kernelSize: int = 1
    lstep: float = 0.05
    astep: float = 0.05
    iterations: int = 5
    lsigma: float = 0.075
    ogain: float = 3.0
    lskip: int = 0
    minimumScore: float = 0.0
    srr: float = 0.1
    srt: float = 0.2
    str: float = 0.1
    stt: float = 0.2
    linearUpdate: float = 1.0
    angularUpdate: float = 0.5
    temporalUpdate: float = -1.0
    resampleThreshold: float = 0.5
    particles: int = 30
    xmin: float = -100.0
    ymin: float = -100.0
    xmax: float = 100.0
    ymax: float = 100.0
    delta: float = 0.05
    llsamplerange: Annotated[float, _NEVER_SAMPLED] = 0.01
    llsamplestep: Annotated[float, _NEVER_SAMPLED] = 0.01
    lasamplerange: Annotated[float, _NEVER_SAMPLED] = 0.005
    lasamplestep: Annotated[float, _NEVER_SAMPLED] = 0.005
    seed: int = 0
    transform_future_limit: float = 10.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            self._check(
                not isinstance(value, float) or math.isfinite(value), field.name, "be finite"
            )
        for name in _POSITIVE:
            self._check(getattr(self, name) > 0, name, "be positive")
        for name in _NOT_NEGATIVE:
            self._check(getattr(self, name) >= 0 or name == "tf_delay", name, "not be negative")
        self._check(self.throttle_scans >= 1, "throttle_scans", "be at least 1")
        self._check(self.particles >= 1, "particles", "be at least 1")
        self._check(0.0 <= self.occ_thresh <= 1.0, "occ_thresh", "be between 0 and 1")
        self._check(self.xmax > self.xmin, "xmax", "be above ~xmin")
        self._check(self.ymax > self.ymin, "ymax", "be above ~ymin")

    def _check(self, right: bool, name: object, rule: object) -> None:
        if not right:
            raise ParameterError(
                f"slam_gmapping: parameter ~{name} must {rule}, not {getattr(self, f'{name}')!r}"
            )
