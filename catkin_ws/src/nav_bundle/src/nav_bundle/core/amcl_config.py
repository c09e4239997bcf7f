"""amcl's parameters under their names in ROS Noetic, with its defaults."""

import math
from dataclasses import dataclass, fields

from pioneer_node.core.parameter import ParameterError

LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam")
"""Values of ``laser_model_type``."""
ODOM_MODELS = ("diff", "omni", "diff-corrected", "omni-corrected")
"""Values of ``odom_model_type``."""
UNSUPPORTED = frozenset(
    {"bag_scan_period", "restore_defaults", "std_warn_level_x", "std_warn_level_y", "std_warn_level_yaw"}
)
"""Noetic's parameters that have no effect here; the node says so once when they are set."""


@dataclass(frozen=True)
class AmclConfig:
    """Parameters of amcl, documented one by one in config/amcl_defaults.yaml; SI units.

    Two are ours: ``seed`` of the random generator, so that a run can be repeated, and ``refine_estimate``.

    Raises:
        ParameterError: a value out of its range.
    """

    seed: int = 0
    refine_estimate: bool = True
    use_map_topic: bool = False
    first_map_only: bool = False
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"
    global_frame_id: str = "map"
    transform_tolerance: float = 0.1
    tf_broadcast: bool = True
    gui_publish_rate: float = -1.0
    save_pose_rate: float = 0.5
    initial_pose_x: float = 0.0
    initial_pose_y: float = 0.0
    initial_pose_a: float = 0.0
    initial_cov_xx: float = 0.25
    initial_cov_yy: float = 0.25
    initial_cov_aa: float = (math.pi / 12.0) ** 2
    min_particles: int = 100
    max_particles: int = 5000
    kld_err: float = 0.01
    kld_z: float = 0.99
    update_min_d: float = 0.2
    update_min_a: float = math.pi / 6.0
    resample_interval: int = 2
    selective_resampling: bool = False
    recovery_alpha_slow: float = 0.001
    recovery_alpha_fast: float = 0.1
    force_update_after_initialpose: bool = False
    force_update_after_set_map: bool = False
    odom_model_type: str = "diff"
    odom_alpha1: float = 0.2
    odom_alpha2: float = 0.2
    odom_alpha3: float = 0.2
    odom_alpha4: float = 0.2
    odom_alpha5: float = 0.2
    laser_model_type: str = "likelihood_field"
    laser_min_range: float = -1.0
    laser_max_range: float = -1.0
    laser_max_beams: int = 30
    laser_z_hit: float = 0.95
    laser_z_short: float = 0.1
    laser_z_max: float = 0.05
    laser_z_rand: float = 0.05
    laser_sigma_hit: float = 0.2
    laser_lambda_short: float = 0.1
    laser_likelihood_max_dist: float = 2.0
    do_beamskip: bool = False
    beam_skip_distance: float = 0.5
    beam_skip_threshold: float = 0.3
    beam_skip_error_threshold: float = 0.9

    def __post_init__(self) -> None:
        self._check(self.odom_model_type in ODOM_MODELS, "odom_model_type", "be one of " + ", ".join(ODOM_MODELS))
        self._check(self.laser_model_type in LASER_MODELS, "laser_model_type", "be one of " + ", ".join(LASER_MODELS))
        self._check(self.min_particles >= 1, "min_particles", "be at least 1")
        self._check(self.max_particles >= self.min_particles, "max_particles", "not be below ~min_particles")
        self._check(self.laser_max_beams >= 2, "laser_max_beams", "be at least 2")
        self._check(self.resample_interval >= 1, "resample_interval", "be at least 1")
        self._check(self.seed >= 0, "seed", "not be negative")
        for name in ("kld_err", "laser_sigma_hit", "laser_likelihood_max_dist", "laser_lambda_short"):
            self._check(getattr(self, name) > 0.0, name, "be positive")
        for field in fields(self):
            value = getattr(self, field.name)
            self._check(not isinstance(value, float) or math.isfinite(value), field.name, "be finite")
            if field.name.startswith(("odom_alpha", "laser_z_", "initial_cov_", "recovery_alpha_")):
                self._check(value >= 0.0, field.name, "not be negative")

    def _check(self, right: bool, name: str, rule: str) -> None:
        if not right:
            raise ParameterError(f"amcl: parameter ~{name} must {rule}, not {getattr(self, name)!r}")
