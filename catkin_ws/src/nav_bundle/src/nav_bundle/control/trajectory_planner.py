"""The local planner TrajectoryPlannerROS: trajectory rollout."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.velocity import Velocity
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.local_planner import Situation
from nav_bundle.control.rollout import Rollout, Scored
from nav_bundle.control.sampling_planner import SamplingPlanner
from nav_bundle.control.trajectory_config import TrajectoryConfig
from nav_bundle.control.trajectory_kernel import Horizon, Scales

_STANDING = 1.0e-3
_CRAWL = 0.1
"""Slowest forward speed tried [m/s], or a quarter of the maximum if that is less: slower samples look only a few
centimetres ahead, and so lead up to the obstacle."""
_DEAD_END_RADIUS = 0.2
"""A sample that ends within this distance [m] of the pose where the robot last had to back up leads to a dead end."""
_LONGEST_ESCAPE = 0.8
"""A robot that returns to the same dead end backs up twice as far as before, up to this distance [m]."""
_SHORT_ESCAPES = tuple((time, turn) for time in (0.5, 0.3) for turn in (0.0, 0.2, -0.2, 0.4, -0.4))
"""Escapes tried if straight back is not free over the whole horizon: duration [s] and turning speed [rad/s]. The
durations exceed the stopping time."""
_CIRCLE_RADIUS = 0.5
"""A robot that has turned in place by more than half a circle accepts any sample that makes progress, whatever its
cost, until it has moved this far [m]."""
_LONGEST_TURN = 1.15 * math.pi
"""Half a circle leads to every heading: a robot that turns by more than this [rad] looks for what it cannot find."""
_SHORT_REACH = 0.5
"""Reach [m] below which a robot is short-sighted: its samples show the clearance cost on the way but little of the
progress, so that stopping to turn would be cheapest at each corner."""
_HEADING_SCALE = 0.3
"""Cost per radian between the robot's heading and the plan, with ``heading_scoring``, as in base_local_planner."""


@dataclass
class _Turning:
    """Prevents swaying in place: after a turn one way, the robot may not turn the other way until it has moved."""

    left: bool = False
    right: bool = False
    since: Pose | None = None
    angle: float = 0.0
    _place: Pose | None = None

    @property
    def circled(self) -> bool:
        """Whether the robot has turned in place by more than half a circle."""
        return abs(self.angle) > _LONGEST_TURN

    def note(self, chosen: Velocity, pose: Pose, reset_distance: float) -> None:
        """Records the command chosen at ``pose``."""
        if chosen.x <= 0.0 and chosen.turn != 0.0:
            self.left, self.right = chosen.turn > 0.0, chosen.turn < 0.0
        if self._place is None or pose.distance(self._place) > _CIRCLE_RADIUS:
            self._place, self.angle = pose, 0.0
        self.angle += angle_difference(pose.yaw, self._place.yaw)
        self._place = replace(self._place, yaw=pose.yaw)
        if self.since is None or pose.distance(self.since) > reset_distance:
            if self.since is not None:
                self.left = self.right = False
            self.since = pose


class TrajectoryPlanner(SamplingPlanner[TrajectoryConfig]):
    """Samples velocities, simulates each on the local costmap, and returns the cheapest.

    The cost of a sample adds up the distances of its end point to the plan and to the plan's last point inside the
    costmap, and the highest costmap cost along the trajectory. Turns in place are at least
    ``min_in_place_vel_theta`` fast and are compared by the distance of a point a little ahead. If no forward sample is
    valid, the robot backs up with ``escape_vel`` until it has moved or turned enough.
    Unlike base_local_planner, it never backs into lethal cells. It also turns in place if the cheapest sample makes no
    progress towards the goal, since standing still, or the way back into a dead end that the robot has just left, can
    be the cheapest.
    """

    _no_command = (
        "The rollout planner failed to find a valid plan. This means that the footprint of the robot was in collision "
        "for all simulated trajectories."
    )

    def __init__(self, config: TrajectoryConfig, resolution: float) -> None:
        """Creates a planner from the configuration and the local costmap's cell size [m]."""
        unit = resolution if config.meter_scoring else 1.0
        rollout = Rollout(
            Velocity(config.acc_lim_x, config.acc_lim_y, config.acc_lim_theta),
            Horizon(
                config.sim_time,
                config.sim_granularity,
                config.angular_sim_granularity,
                config.heading_scoring_timestep,
            ),
            Scales(
                config.path_distance_bias * unit,
                config.goal_distance_bias * unit,
                config.occdist_scale * unit,
                _HEADING_SCALE if config.heading_scoring else 0.0,
            ),
            Clearance(config.clearance, config.clearance_scale * unit / resolution),
        )
        still = config.trans_stopped_velocity, config.rot_stopped_velocity
        super().__init__(
            config, rollout, config.min_in_place_vel_theta, -config.min_vel_theta, still
        )
        self._is_short_sighted = config.max_vel_x * config.sim_time < _SHORT_REACH
        self._escape_distance = config.escape_reset_dist

    def _restart(self) -> None:
        super()._restart()
        self._turning = _Turning()
        self._escape_from: Pose | None = None
        self._dead_end: Pose | None = None

    def _best(
        self, situation: Situation, ahead: NDArray[np.float64]
    ) -> tuple[Velocity, float] | None:
        if not self._is_escaping(situation.pose):
            goal_distance = math.hypot(
                ahead[-1, 0] - situation.pose.x, ahead[-1, 1] - situation.pose.y
            )
            fastest = min(goal_distance / self.config.sim_time, situation.fastest)
            samples = self._forward_samples(situation.velocity, fastest)
            forward: Scored | None = self._rollout.cheapest(samples)
            if self._turning.circled:
                self._dead_end = None  # the only way found leads past the dead end
                forward = self._onward(samples, situation.pose) or forward
            if forward is not None and not self._leads_on(forward, situation.pose):
                onward = self._onward(samples, situation.pose) if self._is_short_sighted else None
                chosen: Scored | None = self._turn_in_place(situation, onward) or forward
            elif self._turning.circled and forward is not None:
                chosen = forward
            else:
                chosen = self._turn_in_place(situation, forward)
            if chosen is not None:
                self._turning.note(
                    chosen.velocity, situation.pose, self.config.oscillation_reset_dist
                )
                return chosen.velocity, math.inf
        return self._escape(situation.pose)

    def _range(self, velocity: Velocity) -> tuple[float, float, float, float]:
        """Returns the lowest and highest reachable forward and turning speeds."""
        config = self.config
        time = self._period if config.dwa else config.sim_time
        slowest = max(config.min_vel_x, min(_CRAWL, 0.25 * config.max_vel_x))
        return (
            max(slowest, velocity.x - config.acc_lim_x * time),
            max(min(config.max_vel_x, velocity.x + config.acc_lim_x * time), slowest),
            max(config.min_vel_theta, velocity.turn - config.acc_lim_theta * time),
            min(config.max_vel_theta, velocity.turn + config.acc_lim_theta * time),
        )

    def _forward_samples(self, velocity: Velocity, limit: float) -> NDArray[np.float64]:
        """Returns straight and curved samples (n, 3), no faster than ``limit`` unless braking takes longer.

        A holonomic robot also gets its sideways samples that are no faster, or at least the slowest to each side.

        Standstill is excluded: it is always free, so in front of an obstacle it would be chosen forever.
        """
        slowest, fastest, right, left = self._range(velocity)
        fastest = max(min(fastest, limit), slowest)
        speeds = np.linspace(slowest, fastest, self.config.vx_samples)
        speeds = speeds[np.abs(speeds) > _STANDING]
        turns = np.concatenate([[0.0], np.linspace(right, left, self.config.vtheta_samples)])
        samples = np.zeros((len(speeds), len(turns), 3))
        samples[:, :, 0] = speeds[:, None]
        samples[:, :, 2] = turns[None, :]
        return np.concatenate([samples.reshape(-1, 3), self._sideways_samples(limit)])

    def _sideways_samples(self, limit: float) -> NDArray[np.float64]:
        speeds = self.config.sideways()
        slowest = min((abs(speed) for speed in speeds if speed), default=0.0)
        tried = [speed for speed in speeds if 0.0 < abs(speed) <= max(limit, slowest)]
        samples = np.zeros((len(tried), 3))
        samples[:, 1] = tried
        return samples

    def _turn_in_place(self, situation: Situation, best: Scored | None) -> Scored | None:
        """Returns the turn in place with the shortest distance ahead, if it costs no more than ``best``, else ``best``.

        A short-sighted robot also gets ``best`` if no turn improves on its current heading.
        """
        _, _, right, left = self._range(situation.velocity)
        step = (left - right) / max(self.config.vtheta_samples - 1, 1)
        turns = [
            turn
            for turn in np.linspace(right, left, self.config.vtheta_samples)
            if abs(turn) > step
        ]
        samples = np.zeros((len(turns), 3))
        samples[:, 2] = [
            math.copysign(max(abs(turn), self.config.min_in_place_vel_theta), turn)
            for turn in turns
        ]
        chosen, nearest = best, math.inf
        for turned in self._rollout.all_of(samples, math.inf if best is None else best.cost):
            ahead = self._distance_ahead(turned.end)
            if ahead < nearest and not self._is_swaying(turned.velocity.turn):
                chosen, nearest = turned, ahead
        if (
            self._is_short_sighted
            and best is not None
            and nearest >= self._distance_ahead(situation.pose)
        ):
            return best
        return chosen

    def _onward(self, samples: NDArray[np.float64], pose: Pose) -> Scored | None:
        """Returns the cheapest sample that makes progress, even if standing is cheaper; None if there is none."""
        onward = [
            scored for scored in self._rollout.all_of(samples) if self._leads_on(scored, pose)
        ]
        return min(onward, key=lambda scored: scored.cost) if onward else None

    def _leads_on(self, scored: Scored, pose: Pose) -> bool:
        """Returns whether a sample makes progress: it ends closer to the local goal, and not in the last dead end.

        Standing and creeping make no progress.
        """
        if self._dead_end is not None and scored.end.distance(self._dead_end) < _DEAD_END_RADIUS:
            return False
        before = self._rollout.goal_distance(pose.x, pose.y)
        after = self._rollout.goal_distance(scored.end.x, scored.end.y)
        return before is not None and after is not None and after < before

    def _is_swaying(self, turn: float) -> bool:
        return self._turning.right if turn > 0.0 else self._turning.left

    def _distance_ahead(self, end: Pose) -> float:
        """Returns the steps to the local goal from the point ``heading_lookahead`` in front of ``end``."""
        x, y = end.apply(self.config.heading_lookahead, 0.0)
        distance = self._rollout.goal_distance(x, y)
        return math.inf if distance is None else float(distance)

    def _is_escaping(self, pose: Pose) -> bool:
        """Returns whether the robot still has to back up; ends the escape once it has moved or turned enough."""
        start = self._escape_from
        if start is None:
            return False
        moved = pose.distance(start) > self._escape_distance
        turned = abs(angle_difference(pose.yaw, start.yaw)) > self.config.escape_reset_theta
        if moved or turned:
            self._escape_from = None
        return not (moved or turned)

    def _way_back(self) -> tuple[Velocity, float] | None:
        """Returns a free velocity to back up, straight if possible, else the first free arc; and its duration [s]."""
        speed = self.config.escape_vel
        ways = [(math.inf, 0.0), *_SHORT_ESCAPES] if speed else []
        backs = ((Velocity(speed, 0.0, turn), time) for time, turn in ways)
        return next((back for back in backs if self._rollout.is_free(*back)), None)

    def _escape(self, pose: Pose) -> tuple[Velocity, float] | None:
        """Returns a velocity to back up and how long [s] it is free; None if backing up is not possible."""
        back = self._way_back()
        if back is None:
            self._escape_from = None
            return None
        if self._escape_from is None:
            # Beside a wall, backing up by the same distance again would only lead back to this dead end.
            again = self._dead_end is not None and pose.distance(self._dead_end) < _DEAD_END_RADIUS
            longer = min(
                2.0 * self._escape_distance, max(_LONGEST_ESCAPE, self.config.escape_reset_dist)
            )
            self._escape_distance = longer if again else self.config.escape_reset_dist
            self._escape_from = self._dead_end = pose
        return back
