"""The services of gazebo_ros for time and physics: pause, reset, step, engine settings."""

import math

from gazebo_msgs import srv
from gazebo_msgs.msg import ODEPhysics
from geometry_msgs.msg import Vector3
from std_srvs.srv import Empty, Trigger

from pioneer_gazebo.conversions import vector_from_message
from pioneer_gazebo.core.engine import Physics
from pioneer_gazebo.core.error import ModelError
from pioneer_gazebo.core.schedule import TICK_RATE
from pioneer_gazebo.nodes.robots import Robots
from pioneer_gazebo.nodes.service import serve
from pioneer_gazebo.nodes.timeline import Timeline


class TimeServices:
    """Pauses, resumes, steps and resets simulated time, and configures physics."""

    def __init__(self, timeline: Timeline, robots: Robots) -> None:
        """Starts the services."""
        self._timeline, self._robots, self._simulation = timeline, robots, timeline.simulation
        mailbox = timeline.mailbox
        serve("get_physics_properties", srv.GetPhysicsProperties, lambda _: self._physics(), mailbox)
        serve("set_physics_properties", srv.SetPhysicsProperties, self._set_physics, mailbox)
        serve("pause_physics", Empty, lambda _: timeline.pause(True), mailbox)
        serve("unpause_physics", Empty, lambda _: timeline.pause(False), mailbox)
        serve("reset_world", Empty, lambda _: self._reset_world(), mailbox)
        serve("reset_simulation", Empty, lambda _: self._reset_simulation(), mailbox)
        serve("step", Trigger, lambda _: self._step(), mailbox)

    def _physics(self) -> srv.GetPhysicsPropertiesResponse:
        physics = self._simulation.physics
        return srv.GetPhysicsPropertiesResponse(
            time_step=physics.step,
            pause=self._timeline.paused,
            max_update_rate=self._timeline.pacer.factor / physics.step,
            gravity=Vector3(*physics.gravity),
            ode_config=ODEPhysics(sor_pgs_iters=physics.iterations, sor_pgs_w=1.0),
            status_message="of ode_config only sor_pgs_iters is used here",
        )

    def _set_physics(self, request: srv.SetPhysicsPropertiesRequest) -> str:
        if not (math.isfinite(request.max_update_rate) and request.max_update_rate >= 0):
            raise ValueError(f"max_update_rate must be 0 (as fast as possible) or more, not {request.max_update_rate}")
        if not (math.isfinite(request.time_step) and request.time_step > 0):
            raise ValueError(f"time_step must be above 0, not {request.time_step}")
        iterations = request.ode_config.sor_pgs_iters or self._simulation.physics.iterations
        gravity = vector_from_message(request.gravity)
        # Steps are integer numbers of ticks: a step that was read and rounded by a caller must not change.
        ticks = round(request.time_step * TICK_RATE)
        step = ticks / TICK_RATE if abs(ticks - request.time_step * TICK_RATE) < 1e-3 and ticks else request.time_step
        self._simulation.configure(Physics(step, iterations, gravity))
        self._timeline.set_factor(request.max_update_rate * step)
        return "physics set"

    def _reset_world(self) -> None:
        self._simulation.reset_poses()
        self._timeline.publish_now()

    def _reset_simulation(self) -> None:
        self._simulation.reset()
        self._timeline.restart()
        self._robots.reset()
        self._timeline.publish_now()

    def _step(self) -> str:
        if not self._timeline.paused:
            raise ModelError("step works while physics is paused (pause_physics)")
        self._timeline.step()
        return f"simulated time is {self._simulation.tick / TICK_RATE:.6f} s"
