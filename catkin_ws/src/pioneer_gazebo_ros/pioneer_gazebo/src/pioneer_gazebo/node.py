"""The simulator node ``/gazebo``."""

from dataclasses import dataclass, replace
from time import monotonic
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Bool, Float64

from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.lockstep.gate import LockstepConfig, LockstepGate
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.ros.mailbox import Mailbox
from pioneer_gazebo.ros.topic import TransformTopic, publish_while_alive
from pioneer_gazebo.services.state_services import StateServices
from pioneer_gazebo.services.world_services import WorldServices
from pioneer_gazebo.simulation.noise_profile import PROFILES
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Timeline
from pioneer_gazebo.topics.robots import Robots, with_controllers
from pioneer_gazebo.world.mesh import prepare, triangles_of_mesh
from pioneer_gazebo.world.resource import model_path, world_path
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes import entry

SLOW = 0.9
"""Below this fraction of the requested real-time factor, the status is a warning."""


def judged(measured: float, asked: float, paused: bool) -> tuple[int, str]:
    """Returns level and message for a real-time factor; measured and requested (0: as fast as possible)."""
    if paused:
        return DiagnosticStatus.OK, "paused"
    if asked > 0 and measured < SLOW * asked:
        return DiagnosticStatus.WARN, f"slower than asked for: {measured:.2f} of {asked:g}"
    return DiagnosticStatus.OK, "running"


OF_THE_WORLD = -1.0
"""Real-time factor of the world's ``<physics>``; 1 if it asks for none."""

REPORT_PERIOD = 1.0
"""Interval at which the real-time factor is measured and published [s of wall time]."""


@dataclass(frozen=True, slots=True)
class GazeboConfig:
    """Parameters of the node; see the package's README."""

    world_name: str = "utm_0"
    paused: bool = False
    real_time_factor: float = OF_THE_WORLD
    seed: int = 0
    physics_rate: float = 50.0
    solver_iterations: int = 20
    clock_rate: float = 100.0
    state_rate: float = 50.0
    odometry_error: float = 0.0
    odometry_scale: float = 1.0
    noise: str = "described"
    spawn_search: float = 0.5
    gui: bool = False
    lockstep: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        """Rejects invalid values; raises ParameterError."""
        is_factor = 0 <= self.real_time_factor < float("inf")
        if not is_factor and self.real_time_factor != OF_THE_WORLD:
            raise ParameterError(
                "~real_time_factor must be 0 (as fast as possible) or more, or -1 (the world's), "
                f"not {self.real_time_factor}"
            )
        if self.solver_iterations < 1:
            raise ParameterError(
                f"~solver_iterations must be 1 or more, not {self.solver_iterations}"
            )
        if not (self.odometry_error >= 0 and self.odometry_scale > 0):
            raise ParameterError(
                "~odometry_error must not be negative and ~odometry_scale must be above 0, "
                f"not {self.odometry_error} and {self.odometry_scale}"
            )
        if self.noise not in PROFILES:
            raise ParameterError(f"~noise must be {' or '.join(PROFILES)}, not {self.noise!r}")
        if not 0 <= self.spawn_search <= 10:
            raise ParameterError(f"~spawn_search must be 0 … 10 m (got {self.spawn_search})")
        if not self.physics_rate > 0:
            raise ParameterError(f"~physics_rate must be above 0, not {self.physics_rate}")


class GazeboNode:
    """The simulator.

    Subscribes: ``/gazebo/set_model_state``, ``/gazebo/set_link_state``, and the command topics of each robot's drives.

    Publishes: ``/clock``, ``/tf``, ``/gazebo/model_states``, ``/gazebo/link_states``, ``/gazebo/ready`` (latched),
        ``/gazebo/real_time_factor``, ``/diagnostics``, and each robot's topics (see `Robots`).

    Services: those of gazebo_ros, and ``/gazebo/step`` (`WorldServices`, `StateServices`).

    Parameters: `GazeboConfig`.

    Threads: `spin` owns the simulation. Services and subscribers pass work to it through a `Mailbox`; velocity
        commands go through the drive's queue, with their arrival tick.

    On error: invalid input is answered or logged in one line, and the simulation continues.
    """

    def __init__(self, config: GazeboConfig) -> None:
        """Loads the world.

        Raises:
            SimulatorError: the world cannot be loaded.
        """
        mailbox = Mailbox()
        gate = None if config.lockstep is None else self._gate(config.lockstep, mailbox)
        path = world_path(config.world_name)
        world = world_from_sdf(path, model_path())
        for line in world.warnings:
            rospy.logwarn("%s: %s", path, line)
        for model in world.models:
            prepare(model.links, model.static, rospy.loginfo)
        physics = Physics(1.0 / config.physics_rate, config.solver_iterations, world.gravity)
        self._engine = BulletEngine(physics, config.gui)
        self._simulation = Simulation(
            self._engine,
            triangles_of_mesh,
            physics,
            config.seed,
            config.odometry_error,
            config.odometry_scale,
            PROFILES[config.noise],
        )
        self._simulation.spawn_search = config.spawn_search
        models = tuple(with_controllers(model) for model in world.models)
        for line in self._simulation.load(replace(world, models=models)):
            rospy.logwarn("%s: %s", path, line)
        factor = config.real_time_factor
        if factor == OF_THE_WORLD:
            factor = 1.0 if world.real_time_factor is None else world.real_time_factor
        self._timeline = Timeline(
            self._simulation,
            mailbox,
            factor,
            config.paused,
            config.clock_rate,
            self._after_tick,
            gate,
        )
        self._transforms = TransformTopic(self._timeline.schedule.review)
        self._robots = Robots(self._simulation, self._timeline, self._transforms)
        self._robots.start_topics()
        self._factor = rospy.Publisher("/gazebo/real_time_factor", Float64, queue_size=1)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=1)
        self._ready = rospy.Publisher("/gazebo/ready", Bool, queue_size=1, latch=True)
        self._reported = 0.0
        StateServices(self._timeline, config.state_rate)
        WorldServices(self._timeline, self._robots)
        rospy.on_shutdown(mailbox.close)
        rospy.loginfo("world %s: %d models", world.name, len(world.models))

    def _gate(self, parameters: dict[str, Any], mailbox: Mailbox) -> LockstepGate:
        """Returns the lockstep gate. Must run before any publisher is created, because it replaces rospy's."""

        def namespaces() -> set[str]:
            return {
                entity.namespace
                for entity in self._simulation.entities()
                if entity.robot is not None
            }

        config = config_from_mapping(LockstepConfig, parameters, f"{rospy.get_name()}/lockstep")
        return LockstepGate(config, mailbox, namespaces)

    def spin(self) -> None:
        """Runs the simulation until the node shuts down."""
        publish_while_alive(self._ready, Bool(True))
        self._timeline.publish_now()
        while not rospy.is_shutdown():
            self._timeline.serve()
            self._report()
            self._timeline.turn(REPORT_PERIOD)
        self._robots.close()
        self._engine.close()

    def _after_tick(self) -> None:
        self._transforms.flush()
        self._robots.publish_collisions()
        self._robots.remove_lost()

    def _report(self) -> None:
        timeline = self._timeline
        now = monotonic()
        if now - self._reported >= REPORT_PERIOD:
            self._reported = now
            time = timeline.tick / TICK_RATE
            factor = timeline.pacer.measured(time)
            publish_while_alive(self._factor, Float64(factor))
            if self._diagnostics.get_num_connections():
                publish_while_alive(self._diagnostics, self._diagnosis(time, factor))

    def _diagnosis(self, time: float, factor: float) -> DiagnosticArray:
        """Returns one status, named after the node, for a simulated time [s] and the measured real-time factor."""
        asked = self._timeline.pacer.factor
        level, message = judged(factor, asked, self._timeline.paused)
        values = {
            "simulated time [s]": f"{time:.3f}",
            "real-time factor": f"{factor:.3f}",
            "real-time factor asked for": f"{asked:g}",
            "models": str(len(self._simulation.names())),
            "robots": str(len(self._robots)),
        }
        status = DiagnosticStatus(
            level, f"{rospy.get_name()[1:]}: simulation", message, "pioneer_gazebo", []
        )
        status.values = [KeyValue(key, value) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        whole, rest = divmod(time, 1.0)
        array.header.stamp = rospy.Time(int(whole), int(rest * 1e9))
        return array


def main() -> int:
    """Runs the node; returns the exit status."""

    def build() -> GazeboNode:
        return GazeboNode(config_from_mapping(GazeboConfig, entry.parameters(), rospy.get_name()))

    return entry.run("gazebo", build, (SimulatorError,), wall_time=True)
