"""The local planner DWAPlannerROS: the dynamic window approach."""

import math

import numpy as np
from numpy.typing import NDArray

from nav_bundle.base.pose import Pose, angle_difference
from nav_bundle.base.velocity import Velocity
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.dwa_config import DwaConfig
from nav_bundle.control.dynamic_window_kernel import Nose, score, trace
from nav_bundle.control.local_planner import Situation
from nav_bundle.control.plan_distance_kernel import goal_grid
from nav_bundle.control.rollout import Rollout
from nav_bundle.control.sampling_planner import SamplingPlanner
from nav_bundle.control.trajectory_kernel import Horizon, Scales
from nav_bundle.planning.planner import Path

_EPSILON = 1.0e-4
_NO_STEPS = np.empty((0, 0), np.int32)


class Oscillation:
    """dwa_local_planner's oscillation critic: after a reversal, the old direction is blocked for a while.

    Sideways motion and turns count only while the forward speed is at most ``slow`` [m/s]. A blocked direction is
    released once the robot is ``distance`` [m] or ``angle`` [rad] away from the pose where it reversed.
    """

    def __init__(self, slow: float, distance: float, angle: float) -> None:
        self._slow, self._distance, self._angle = slow, distance, angle
        self._since = Pose()
        self.reset()

    def reset(self) -> None:
        """Releases all directions and forgets the last motion."""
        # By axis (forward, sideways, turning): sign of the last motion, and the only sign allowed (0 for both).
        self._last, self._only = np.zeros(3), np.zeros(3)

    def allowed(self, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns a mask of the ``samples`` (n, 3) that do not move in a blocked direction."""
        closed: NDArray[np.bool_] = (samples * self._only < 0.0).any(axis=1)
        return ~closed

    def note(self, chosen: Velocity, pose: Pose) -> None:
        """Records the velocity chosen at ``pose``."""
        signs = np.sign([chosen.x, chosen.y, chosen.turn])
        if abs(chosen.x) > self._slow:
            signs[1:] = 0.0
        is_reversed = signs * self._last < 0.0
        self._only[is_reversed] = signs[is_reversed]
        self._last = np.where(signs == 0.0, self._last, signs)
        if is_reversed.any():
            self._since = pose
        turned = abs(angle_difference(pose.yaw, self._since.yaw))
        if (
            pose.distance(self._since) > self._distance or turned > self._angle
        ) and self._only.any():
            self.reset()


class DynamicWindow(Rollout):
    """A rollout that scores samples as dwa_local_planner does: also by the robot's nose, a point in front of the robot.

    The nose is attracted to the plan, and to a point beyond the plan's end as seen from the robot. Unless
    ``accelerating``, a sample starts at its own velocity, since it was chosen from those reachable in one cycle.
    ``is_free`` always accelerates.
    """

    def __init__(
        self,
        acc: Velocity,
        horizon: Horizon,
        scales: Scales,
        clearance: Clearance,
        nose: Nose,
        accelerating: bool,
    ) -> None:
        """Creates the rollout; ``begin_window`` fills the steps to the nose's target."""
        super().__init__(acc, horizon, scales, clearance)
        self._nose, self._alignment, self._accelerating = nose, nose.alignment, accelerating

    def begin_window(self, situation: Situation, plan: NDArray[np.float64], aligned: bool) -> bool:
        """Starts a cycle like ``begin``; the nose follows the plan only if ``aligned``."""
        if not self.begin(situation, plan):
            return False
        to_front = self._nose.to_front
        if to_front.shape != self._to_plan.shape:
            to_front = np.empty_like(self._to_plan)
        self._nose = self._nose._replace(
            to_front=to_front, alignment=self._alignment if aligned else 0.0
        )
        points = np.ascontiguousarray(plan[:, :2])
        pose = situation.pose
        towards = math.atan2(points[-1, 1] - pose.y, points[-1, 0] - pose.x)
        points[-1] += self._nose.length * math.cos(towards), self._nose.length * math.sin(towards)
        return goal_grid(self._floor, points, to_front, self._queue) > 0

    def _search(
        self,
        samples: NDArray[np.float64],
        reach: bool,
        every: bool,
        time: float = math.inf,
        limit: float = math.inf,
    ) -> tuple[int, NDArray[np.float64]]:
        if not reach:
            return super()._search(samples, reach, every, time, limit)
        results = np.empty((len(samples), 5))
        moment = (self._ground, self._nose, self._motion, samples, self._until(time), self._scales)
        return score(*moment, self._accelerating, every, limit, results), results

    def poses(self, velocity: Velocity, time: float = math.inf) -> NDArray[np.float64]:
        """Returns the poses (n, 3) along ``velocity`` within ``time`` [s], at most the horizon."""
        poses = np.empty((256, 3))
        sample = np.array([velocity.x, velocity.y, velocity.turn], np.float64)
        return poses[: trace(self._motion, sample, self._until(time), self._accelerating, poses)]


class DwaPlanner(SamplingPlanner[DwaConfig]):
    """Samples the velocities reachable within one cycle and returns the cheapest.

    As with dwa_local_planner's critics, the cost of a sample adds up: the distances of its end point to the plan and
    to the plan's last point inside the costmap, the same two for the robot's nose, the turning speed, and the highest
    costmap cost along the trajectory. After a reversal, the old direction is blocked until the robot has moved on.
    Unlike dwa_local_planner, turns in place slower than ``min_vel_theta`` are raised to that speed instead of
    discarded: from standstill no faster turn can be reached.
    """

    _no_command = (
        "The dwa local planner failed to find a valid plan, cost functions discarded all candidates. "
        "This can mean there is an obstacle too close to the robot."
    )

    def __init__(self, config: DwaConfig, resolution: float) -> None:
        """Creates a planner from the configuration and the local costmap's cell size [m]."""
        plan, goal = resolution * config.path_distance_bias, resolution * config.goal_distance_bias
        self._window = DynamicWindow(
            Velocity(config.acc_lim_x, config.acc_lim_y, config.acc_lim_theta),
            Horizon(config.sim_time, config.sim_granularity, config.angular_sim_granularity),
            Scales(plan, goal, config.occdist_scale),
            Clearance(config.clearance, config.clearance_scale),
            Nose(config.forward_point_distance, _NO_STEPS, plan, goal, config.twirling_scale),
            not config.use_dwa,
        )
        still = config.trans_stopped_vel, config.theta_stopped_vel
        super().__init__(config, self._window, config.min_vel_theta, config.max_vel_theta, still)
        self._oscillation = Oscillation(
            config.min_vel_trans, config.oscillation_reset_dist, config.oscillation_reset_angle
        )

    def set_plan(self, plan: Path) -> None:
        """Sets a new plan, and releases all directions."""
        super().set_plan(plan)
        self._oscillation.reset()

    def _begin(self, situation: Situation, ahead: NDArray[np.float64]) -> bool:
        aligned = _left(situation, ahead) > self.config.forward_point_distance * math.sqrt(
            self.config.cheat_factor
        )
        return self._window.begin_window(situation, ahead, aligned)

    def _best(
        self, situation: Situation, ahead: NDArray[np.float64]
    ) -> tuple[Velocity, float] | None:
        samples = self._samples(situation, _left(situation, ahead))
        best = self._window.cheapest(samples[self._oscillation.allowed(samples)])
        if best is None:
            return None
        self._oscillation.note(best.velocity, situation.pose)
        return best.velocity, math.inf

    def _samples(self, situation: Situation, left: float) -> NDArray[np.float64]:
        """Returns the velocities (n, 3) to try; the plan's end in the costmap is ``left`` [m] away."""
        config = self.config
        time = 1.0 / config.controller_frequency if config.use_dwa else config.sim_time
        now = situation.velocity
        fastest = min(config.max_vel_x, situation.fastest)
        if not config.use_dwa:
            fastest = min(fastest, left / config.sim_time)
        change = config.acc_lim_x * time, config.acc_lim_y * time, config.acc_lim_theta * time
        forward = _reachable(now.x, change[0], config.min_vel_x, max(fastest, config.min_vel_x))
        sideways = _reachable(now.y, change[1], config.min_vel_y, config.max_vel_y)
        turning = _reachable(now.turn, change[2], -config.max_vel_theta, config.max_vel_theta)
        turns = _spread(*turning, config.vth_samples)
        axes = np.meshgrid(
            _spread(*forward, config.vx_samples),
            _spread(*sideways, config.vy_samples),
            turns,
            indexing="ij",
        )
        return self._possible(np.stack(axes, axis=-1).reshape(-1, 3), turns)

    def _possible(
        self, samples: NDArray[np.float64], turns: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns the samples that the robot can execute, including turns in place."""
        config = self.config
        speed = np.hypot(samples[:, 0], samples[:, 1])
        moving = speed + _EPSILON >= config.min_vel_trans
        turning = (np.abs(samples[:, 2]) + _EPSILON >= config.min_vel_theta) & (speed > _EPSILON)
        kept = samples[(moving | turning) & (speed - _EPSILON <= config.max_vel_trans)]
        raised = {
            math.copysign(max(abs(turn), config.min_vel_theta), turn)
            for turn in turns.tolist()
            if turn != 0.0
        }
        in_place = np.zeros((len(raised), 3))
        in_place[:, 2] = sorted(raised)
        return np.concatenate([kept, in_place])


def _left(situation: Situation, ahead: NDArray[np.float64]) -> float:
    """Returns the distance [m] to the plan's end in the costmap."""
    return math.hypot(ahead[-1, 0] - situation.pose.x, ahead[-1, 1] - situation.pose.y)


def _reachable(now: float, change: float, slowest: float, fastest: float) -> tuple[float, float]:
    """Returns the part of ``slowest`` to ``fastest`` within ``change`` of ``now``; if empty, the nearest limit."""
    low, high = max(slowest, now - change), min(fastest, now + change)
    return (low, high) if low <= high else ((high, high) if now < slowest else (low, low))


def _spread(low: float, high: float, count: int) -> NDArray[np.float64]:
    """Returns ``count`` values from ``low`` to ``high``, at least both ends, plus zero if it lies between."""
    if low == high:
        return np.array([low])
    values = np.linspace(low, high, max(count, 2))
    return np.union1d(values, [0.0]) if low < 0.0 < high else values
