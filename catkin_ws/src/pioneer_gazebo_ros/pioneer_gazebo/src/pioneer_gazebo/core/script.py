"""Computes the pose of a scripted model over time: SDF's ``<actor><script>``, as played by Gazebo.

Positions follow a cardinal spline through the waypoints; rotations are interpolated the short way.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace

from pioneer_gazebo.core.pose import Pose, Vector, between


@dataclass(frozen=True, slots=True)
class Waypoint:
    """The model's pose in the world at ``time`` [s] after the start of its trajectory."""

    time: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A path through waypoints; the model waits at the first waypoint until its time."""

    waypoints: tuple[Waypoint, ...]  #: one or more, with increasing times >= 0
    #: 0 (Catmull-Rom, which may overshoot corners) … 1 (straight lines, slowing down at each waypoint)
    tension: float = 0.0

    @property
    def duration(self) -> float:
        """The time of the last waypoint [s]."""
        return self.waypoints[-1].time

    def pose(self, time: float) -> Pose:
        """Returns the pose at ``time`` [s] after the trajectory's start."""
        points = self.waypoints
        after = bisect_right(points, time, key=lambda point: point.time)
        if after == 0:
            return points[0].pose
        if after == len(points):
            return points[-1].pose
        a, b = points[after - 1], points[after]
        part = (time - a.time) / (b.time - a.time)
        rotation = between(a.pose, b.pose, part).rotation
        return Pose(self._position(after - 1, part), rotation)

    def _position(self, index: int, part: float) -> Vector:
        """Returns the point of the Hermite curve at ``part`` (0 … 1) of the segment after waypoint ``index``."""
        p, q = self.waypoints[index].pose.position, self.waypoints[index + 1].pose.position
        u, v = self._tangent(index), self._tangent(index + 1)
        s, c = part * part, part * part * part
        a, b, d, e = 2 * c - 3 * s + 1, 3 * s - 2 * c, c - 2 * s + part, c - s
        x, y, z = (a * p[i] + b * q[i] + d * u[i] + e * v[i] for i in range(3))
        return x, y, z

    def _tangent(self, index: int) -> Vector:
        """Returns the curve's tangent at a waypoint; if the path's ends coincide, it is smooth there."""
        points = [point.pose.position for point in self.waypoints]
        last = len(points) - 1
        before, after = points[max(index - 1, 0)], points[min(index + 1, last)]
        if index in (0, last) and math.dist(points[0], points[last]) < 1e-6:
            before, after = points[last - 1], points[1]
        half = (1.0 - self.tension) / 2
        return half * (after[0] - before[0]), half * (after[1] - before[1]), half * (after[2] - before[2])


@dataclass(frozen=True, slots=True)
class Script:
    """A model's complete motion, a sequence of trajectories."""

    trajectories: tuple[Trajectory, ...]  #: in playing order
    home: Pose  #: pose before the first trajectory, and always without ``auto_start``
    loop: bool = True  #: whether to repeat from the start
    delay_start: float = 0.0  #: delay before each round [s]
    auto_start: bool = True  #: whether it starts by itself; nothing else can start it here

    def mapped(self, function: Callable[[Pose], Pose]) -> "Script":
        """Returns the script with ``function`` applied to all its poses."""
        trajectories = tuple(
            replace(one, waypoints=tuple(replace(point, pose=function(point.pose)) for point in one.waypoints))
            for one in self.trajectories
        )
        return replace(self, trajectories=trajectories, home=function(self.home))

    def pose(self, time: float) -> Pose:
        """Returns the model's pose at ``time`` [s] after the start of the script."""
        length = sum(trajectory.duration for trajectory in self.trajectories)
        if not self.auto_start or not self.trajectories:
            return self.home
        rounds, elapsed = 0.0, time
        if self.loop and self.delay_start + length > 0:
            rounds, elapsed = divmod(time, self.delay_start + length)
        elapsed -= self.delay_start
        if elapsed < 0:
            return self.trajectories[-1].pose(math.inf) if rounds else self.home
        for trajectory in self.trajectories:
            if elapsed < trajectory.duration:
                return trajectory.pose(elapsed)
            elapsed -= trajectory.duration
        return self.trajectories[-1].pose(math.inf)
