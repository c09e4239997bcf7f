"""The simulator as the node ``/gazebo``."""

from dataclasses import dataclass

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float64

from pioneer_gazebo import conversions
from pioneer_gazebo.adapters.bullet import BulletEngine
from pioneer_gazebo.adapters.mesh import triangles_of_mesh
from pioneer_gazebo.adapters.resource import model_path, world_path
from pioneer_gazebo.adapters.sdf import world_from_sdf
from pioneer_gazebo.adapters.tiny_renderer import TinyRenderer
from pioneer_gazebo.core.engine import Physics
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.robot import Robot
from pioneer_gazebo.core.schedule import TICK_RATE, Schedule, nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.diagnostics import Diagnostics
from pioneer_gazebo.nodes.mailbox import Mailbox
from pioneer_gazebo.nodes.pace import Pacer
from pioneer_gazebo.nodes.robot_topics import RobotTopics
from pioneer_gazebo.nodes.services import Services
from pioneer_gazebo.nodes.state_topics import StateTopics
from pioneer_gazebo.nodes.topic import Topic, publish_while_alive
from pioneer_gazebo.nodes.transform_topic import TransformTopic
from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes import entry

REPORT_PERIOD = 1.0
"""The real-time factor is measured and published every so many seconds of wall time."""

LONGEST = TICK_RATE // 10
"""The world is moved on at least this often [ticks of simulated time], whoever looks at it."""


@dataclass(frozen=True, slots=True)
class GazeboConfig:
    """Parameters of the node; see the package's README."""

    world_name: str = "utm_0"
    paused: bool = False
    real_time_factor: float = 1.0
    seed: int = 0
    physics_rate: float = 50.0
    solver_iterations: int = 20
    clock_rate: float = 100.0
    state_rate: float = 50.0
    odometry_error: float = 0.0
    odometry_scale: float = 1.0
    gui: bool = False

    def __post_init__(self) -> None:
        """Refuses what makes no sense."""
        if not 0 <= self.real_time_factor < float("inf"):
            raise ParameterError(
                f"~real_time_factor must be 0 (as fast as possible) or more, not {self.real_time_factor}"
            )
        if self.solver_iterations < 1:
            raise ParameterError(f"~solver_iterations must be 1 or more, not {self.solver_iterations}")
        if not (self.odometry_error >= 0 and self.odometry_scale > 0):
            raise ParameterError(
                "~odometry_error must not be negative and ~odometry_scale must be above 0, "
                f"not {self.odometry_error} and {self.odometry_scale}"
            )
        if not self.physics_rate > 0:
            raise ParameterError(f"~physics_rate must be above 0, not {self.physics_rate}")


class GazeboNode:
    """The simulator.

    Subscribes: ``/gazebo/set_model_state``, ``/gazebo/set_link_state``, and what each robot's drive listens to.
    Publishes: ``/clock``, ``/tf``, ``/gazebo/model_states``, ``/gazebo/link_states``, ``/gazebo/ready`` (latched),
        ``/gazebo/real_time_factor``, ``/diagnostics``, and each robot's topics (see `RobotTopics`).
    Services: those of gazebo_ros and ``/gazebo/step`` (see `Services`).
    Parameters: `GazeboConfig`.
    Threads: `spin` owns the simulation; services and subscribers hand it their work through a `Mailbox`, velocity
        commands through a queue of their drive, with the tick that they came at.
    On error: bad input is answered or logged in one line, and the simulation goes on.
    """

    def __init__(self, config: GazeboConfig) -> None:
        """Loads the world.

        Raises:
            SimulatorError: the world cannot be loaded.
        """
        self.mailbox = Mailbox()
        self.pacer = Pacer(config.real_time_factor)
        self.paused = config.paused
        self.schedule = Schedule()
        self.tick = self._target = 0
        path = world_path(config.world_name)
        world = world_from_sdf(path, model_path())
        for line in world.warnings:
            rospy.logwarn("%s: %s", path, line)
        physics = Physics(1.0 / config.physics_rate, config.solver_iterations, world.gravity)
        self._renderer: TinyRenderer | None = None
        self._engine = BulletEngine(triangles_of_mesh, physics, config.gui)
        self.simulation = Simulation(
            self._engine, triangles_of_mesh, physics, config.seed, config.odometry_error, config.odometry_scale
        )
        self.simulation.load(world)
        self._robots: dict[str, RobotTopics] = {}
        self._clock = Topic("/clock", Clock, self.schedule.review)
        self._transforms = TransformTopic(self.schedule.review)
        self._factor = rospy.Publisher("/gazebo/real_time_factor", Float64, queue_size=1)
        self._diagnostics = Diagnostics()
        self._ready = rospy.Publisher("/gazebo/ready", Bool, queue_size=1, latch=True)
        self.schedule.add("/clock", config.clock_rate, self._publish_clock, lambda: self._clock.wanted, False)
        StateTopics(self, config.state_rate)
        Services(self)
        self._reported = 0.0
        rospy.on_shutdown(self.mailbox.close)
        rospy.loginfo("world %s: %d models", world.name, len(world.models))

    def spin(self) -> None:
        """Runs the simulation until the node shuts down."""
        publish_while_alive(self._ready, Bool(True))
        self.publish_now()
        while not rospy.is_shutdown():
            self._serve()
            self._report()
            if self.paused:
                self.mailbox.wait(REPORT_PERIOD)
                continue
            tick = self._target = min(self.schedule.next_after(self.tick), self.tick + LONGEST)
            wait = self.pacer.wait_for(tick / TICK_RATE)
            if wait > 0 and (self.mailbox.wait(min(wait, REPORT_PERIOD)) or wait > REPORT_PERIOD):
                continue
            self.run_to(tick)
        if self._renderer is not None:
            self._renderer.close()
        self._engine.close()

    def _serve(self) -> None:
        """Does what has come in, in the world as it is by now."""
        if self.mailbox.pending:
            if not self.paused:
                self.tick = max(self.tick, min(self.present(), self._target - 1))
            self.simulation.advance(self.tick)
            self.mailbox.serve()

    def present(self) -> int:
        """Returns the tick that it is now, or the one that is being worked on where time is behind its pace."""
        reached = self.pacer.reached() * TICK_RATE
        return 0 if self.paused else int(min(reached, self._target))

    def run_to(self, tick: int) -> None:
        """Moves time on to a tick and does what is due then; the world moves only where that is looked at."""
        due = self.schedule.due(tick)
        if tick - self.simulation.tick >= LONGEST or any(task.needs_state for task in due):
            self.simulation.advance(tick)
        self.tick = tick
        for task in due:
            task.action(tick)
        self._transforms.send()
        for entity in self.simulation.collided():
            if entity.name in self._robots:
                self._robots[entity.name].publish_collisions()

    def publish_now(self) -> None:
        """Publishes the time, for those who came while it stood still."""
        self._publish_clock(self.tick)

    def _publish_clock(self, tick: int) -> None:
        self._clock.send(conversions.clock_frame(nanoseconds(tick)))

    def _report(self) -> None:
        now = self.pacer.now()
        if now - self._reported >= REPORT_PERIOD:
            self._reported = now
            time = self.tick / TICK_RATE
            factor = self.pacer.measured(time)
            publish_while_alive(self._factor, Float64(factor))
            models = len(self.simulation.names())
            self._diagnostics.publish(time, factor, self.pacer.factor, self.paused, models, len(self._robots))

    def spawn_robot(self, name: str, namespace: str, robot: Robot, pose: Pose) -> None:
        """Adds a robot and its topics.

        Raises:
            SimulatorError: it cannot be added; nothing is left of it.
        """
        for line in robot.warnings:
            rospy.logwarn("%s: %s", name, line)
        entity = self.simulation.add_robot(name, namespace, robot, pose)
        try:
            self._robots[name] = RobotTopics(
                self.simulation, self.schedule, entity, self._transforms, self.present, self._drawn_by
            )
        except SimulatorError:
            self.simulation.remove(name)
            raise

    def _drawn_by(self) -> TinyRenderer:
        """Returns what draws cameras' pictures, made when the first is asked for."""
        if self._renderer is None:
            self._renderer = TinyRenderer(triangles_of_mesh)
        return self._renderer

    def delete(self, name: str) -> None:
        """Removes a model and its topics.

        Raises:
            ModelError: there is none of that name.
        """
        topics = self._robots.pop(name, None)
        if topics is not None:
            topics.close()
        self.simulation.remove(name)

    def pause(self, paused: bool) -> None:
        """Stops simulated time, or lets it go on."""
        self.paused = paused
        self.pacer.restart()
        self.publish_now()

    def step(self) -> None:
        """Advances by one physics step; only while paused."""
        end = self.tick + round(self.simulation.physics.step * TICK_RATE)
        while (tick := self.schedule.next_after(self.tick)) <= end:
            self.run_to(tick)
        self.simulation.advance(end)
        self.tick = end

    def reset(self, time: bool) -> None:
        """Puts all models back to where they began; with ``time``, simulated time and noise as well."""
        if time:
            self.simulation.reset()
            self.tick = self._target = 0
            self.pacer.restart()
            for topics in self._robots.values():
                topics.reset()
        else:
            self.simulation.reset_poses()
        self.publish_now()


def main() -> int:
    """Runs the node; returns the exit status."""

    def build() -> GazeboNode:
        return GazeboNode(config_from_mapping(GazeboConfig, entry.parameters(), rospy.get_name()))

    return entry.run("gazebo", build, (SimulatorError,), wall_time=True)
