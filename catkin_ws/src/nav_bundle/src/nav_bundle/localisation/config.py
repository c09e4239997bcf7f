"""amcl's parameters, with the names and defaults of ROS Noetic."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

from pioneer_node.core.live import Live, one_of
from pioneer_node.core.parameter import ONLY_LIVE, ParameterError

LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam")
"""Values of ``laser_model_type``."""
ODOM_MODELS = ("diff", "omni", "diff-corrected", "omni-corrected")
"""Values of ``odom_model_type``."""
UNSUPPORTED = frozenset({"bag_scan_period"})
"""Noetic parameters that have no effect here; the node logs this once if they are set."""


@dataclass(frozen=True)
class AmclConfig:
    """Parameters of amcl in SI units; config/amcl_defaults.yaml documents each one.

    Not in Noetic: ``seed`` of the random generator, ``refine_estimate``, ``correction_file`` and
    ``transform_future_limit``.

    Raises:
        ParameterError: a value is out of range.
    """

    seed: int = 0
    refine_estimate: bool = True
    use_map_topic: Annotated[bool, Live()] = False
    first_map_only: Annotated[bool, Live()] = False
    odom_frame_id: Annotated[str, Live()] = "odom"
    base_frame_id: Annotated[str, Live()] = "base_link"
    global_frame_id: Annotated[str, Live()] = "map"
    transform_tolerance: Annotated[float, Live(0.0, 2.0)] = 0.1
    tf_broadcast: Annotated[bool, Live()] = True
    gui_publish_rate: Annotated[float, Live(-1.0, 100.0)] = -1.0
    save_pose_rate: Annotated[float, Live(-1.0, 10.0)] = 0.5
    correction_file: str = ""
    transform_future_limit: float = 10.0
    initial_pose_x: float = 0.0
    initial_pose_y: float = 0.0
    initial_pose_a: float = 0.0
    initial_cov_xx: float = 0.25
    initial_cov_yy: float = 0.25
    initial_cov_aa: float = (math.pi / 12.0) ** 2
    min_particles: Annotated[int, Live(1, 1000)] = 100
    max_particles: Annotated[int, Live(1, 10000)] = 5000
    kld_err: Annotated[float, Live(0.0, 1.0)] = 0.01
    kld_z: Annotated[float, Live(0.0, 1.0)] = 0.99
    update_min_d: Annotated[float, Live(0.0, 5.0)] = 0.2
    update_min_a: Annotated[float, Live(0.0, math.tau)] = math.pi / 6.0
    resample_interval: Annotated[int, Live(1, 20)] = 2
    selective_resampling: Annotated[bool, Live()] = False
    recovery_alpha_slow: Annotated[float, Live(0.0, 0.5)] = 0.001
    recovery_alpha_fast: Annotated[float, Live(0.0, 1.0)] = 0.1
    force_update_after_initialpose: Annotated[bool, Live()] = False
    force_update_after_set_map: Annotated[bool, Live()] = False
    odom_model_type: Annotated[str, one_of(*ODOM_MODELS)] = "diff"
    odom_alpha1: Annotated[float, Live(0.0, 10.0)] = 0.2
    odom_alpha2: Annotated[float, Live(0.0, 10.0)] = 0.2
    odom_alpha3: Annotated[float, Live(0.0, 10.0)] = 0.2
    odom_alpha4: Annotated[float, Live(0.0, 10.0)] = 0.2
    odom_alpha5: Annotated[float, Live(0.0, 10.0)] = 0.2
    laser_model_type: Annotated[str, one_of(*LASER_MODELS)] = "likelihood_field"
    laser_min_range: Annotated[float, Live(-1.0, 1000.0)] = -1.0
    laser_max_range: Annotated[float, Live(-1.0, 1000.0)] = -1.0
    laser_max_beams: Annotated[int, Live(2, 250)] = 30
    laser_z_hit: Annotated[float, Live(0.0, 1.0)] = 0.95
    laser_z_short: Annotated[float, Live(0.0, 1.0)] = 0.1
    laser_z_max: Annotated[float, Live(0.0, 1.0)] = 0.05
    laser_z_rand: Annotated[float, Live(0.0, 1.0)] = 0.05
    laser_sigma_hit: Annotated[float, Live(0.0, 10.0)] = 0.2
    laser_lambda_short: Annotated[float, Live(0.0, 10.0)] = 0.1
    laser_likelihood_max_dist: Annotated[float, Live(0.0, 20.0)] = 2.0
    do_beamskip: Annotated[bool, Live()] = False
    beam_skip_distance: Annotated[float, Live(0.0, 2.0)] = 0.5
    beam_skip_threshold: Annotated[float, Live(0.0, 1.0)] = 0.3
    beam_skip_error_threshold: Annotated[float, Live(0.0, 1.0)] = 0.9
    std_warn_level_x: float = 0.2
    std_warn_level_y: float = 0.2
    std_warn_level_yaw: float = 0.1
    restore_defaults: Annotated[bool, Live(), ONLY_LIVE] = False

    def __post_init__(self) -> None:
        self._check(
            self.odom_model_type in ODOM_MODELS,
            "odom_model_type",
            "be one of " + ", ".join(ODOM_MODELS),
        )
        self._check(
            self.laser_model_type in LASER_MODELS,
            "laser_model_type",
            "be one of " + ", ".join(LASER_MODELS),
        )
        self._check(self.min_particles >= 1, "min_particles", "be at least 1")
        self._check(
            self.max_particles >= self.min_particles, "max_particles", "not be below ~min_particles"
        )
        self._check(self.laser_max_beams >= 2, "laser_max_beams", "be at least 2")
        self._check(self.resample_interval >= 1, "resample_interval", "be at least 1")
        self._check(self.seed >= 0, "seed", "not be negative")
        for name in (
            "kld_err",
            "laser_sigma_hit",
            "laser_likelihood_max_dist",
            "laser_lambda_short",
        ):
            self._check(getattr(self, name) > 0.0, name, "be positive")
        for field in fields(self):
            value = getattr(self, field.name)
            self._check(
                not isinstance(value, float) or math.isfinite(value), field.name, "be finite"
            )
            if field.name.startswith(("odom_alpha", "laser_z_", "initial_cov_", "recovery_alpha_")):
                self._check(value >= 0.0, field.name, "not be negative")

    def _check(self, right: bool, name: str, rule: str) -> None:
        if not right:
            raise ParameterError(
                f"amcl: parameter ~{name} must {rule}, not {getattr(self, name)!r}"
            )
