"""What one robot publishes and listens to, each topic at its own rate and only while somebody subscribes."""

from collections.abc import Callable
from typing import Any

import rospy
from gazebo_msgs.msg import ContactsState, ContactState
from geometry_msgs.msg import Twist, Vector3, Wrench
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import JointState, LaserScan, Range
from std_msgs.msg import UInt32

from pioneer_gazebo import conversions
from pioneer_gazebo.core import robot as kinds
from pioneer_gazebo.core.camera import Renderer
from pioneer_gazebo.core.drive import CommandError
from pioneer_gazebo.core.engine import Contact
from pioneer_gazebo.core.entity import Driven, Entity, Mounted
from pioneer_gazebo.core.laser import generator_for
from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector, rotated
from pioneer_gazebo.core.schedule import Schedule, nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.camera_topics import CameraTopics
from pioneer_gazebo.nodes.driver_topics import DriverTopics
from pioneer_gazebo.nodes.topic import Topic, publish_while_alive
from pioneer_gazebo.nodes.transform_topic import TransformTopic
from pioneer_node.core.frame import resolved, stripped


class RobotTopics:
    """One robot's topics.

    Subscribes: the drive's ``commandTopic`` (geometry_msgs/Twist).
    Publishes: the drive's ``odometryTopic`` (nav_msgs/Odometry) and transform, ``sensor_msgs/LaserScan`` a laser,
        ``sensor_msgs/Range`` a sonar, ``sensor_msgs/JointState``, ground truth (nav_msgs/Odometry), bumpers
        (gazebo_msgs/ContactsState, while in contact), `DriverTopics`, `CameraTopics`, and ``collisions``
        (std_msgs/UInt32, latched).
    Parameters: ``tf_prefix`` in the robot's namespace or above, read once.
    Threads: all but the subscribers' callbacks, which only store a command, run in the simulation's thread.
    On error: a command that is not finite is named once a second and the one before holds.
    """

    def __init__(
        self,
        simulation: Simulation,
        schedule: Schedule,
        entity: Entity,
        transforms: TransformTopic,
        now: Callable[[], int],
        renderer: Callable[[], Renderer],
    ) -> None:
        """Advertises and schedules all that the robot's description asks for; ``now`` is the tick a command comes at.

        Raises:
            RateError: a rate does not divide the simulator's; nothing is left behind.
        """
        self._simulation, self._schedule, self._entity = simulation, schedule, entity
        self._transforms, self._now, self._renderer = transforms, now, renderer
        self._base = f"/{entity.namespace}" if entity.namespace else ""
        self._prefix = _tf_prefix(self._base)
        self._tasks: list[Any] = []
        self._topics: list[Topic] = []
        self._subscribers: list[rospy.Subscriber] = []
        self._drivers: list[DriverTopics] = []
        self._collisions: rospy.Publisher | None = None
        try:
            self._start()
        except Exception:
            self.close()
            raise

    def _start(self) -> None:
        robot = self._entity.robot
        assert robot is not None, "only a robot has topics"
        for driven in self._entity.drives:
            self._drive(driven)
        for mounted in self._entity.lasers:
            self._laser(mounted)
        for config, mounted in zip(robot.sonars, self._entity.sonars, strict=True):
            self._sonar(config, mounted)
        for truth in robot.ground_truths:
            self._ground_truth(truth)
        for camera in robot.cameras:
            topics = CameraTopics(self._simulation, self._entity, camera, self._renderer)
            topics.start(self._topic, self._every, self._frame(camera.frame))
        for bumper in robot.bumpers:
            self._bumper(bumper)
        for states in robot.joint_state_publishers:
            self._joint_states(states)
        for base in robot.base_drivers:
            frame = self._frame(base.frameName)
            self._drivers.append(
                DriverTopics(self._simulation, self._schedule, self._entity, base, self._base, frame, self._topic)
            )
        self._collisions = rospy.Publisher(f"{self._base}/collisions", UInt32, latch=True, queue_size=1)
        self.publish_collisions()

    def close(self) -> None:
        """Takes everything back."""
        for task in self._tasks:
            self._schedule.remove(task)
        for driver in self._drivers:
            driver.close()
        for topic in self._topics:
            topic.close()
        for subscriber in self._subscribers:
            subscriber.unregister()
        if self._collisions is not None:
            self._collisions.unregister()

    def reset(self) -> None:
        """Tells that time has begun anew."""
        for driver in self._drivers:
            driver.reset()
        self.publish_collisions()

    def publish_collisions(self) -> None:
        """Publishes how often the robot has collided since it was spawned."""
        if self._collisions is not None:
            publish_while_alive(self._collisions, UInt32(self._entity.collisions.count))

    def _topic(self, name: str, message_class: type) -> Topic:
        topic = Topic(name if name.startswith("/") else f"{self._base}/{name}", message_class, self._schedule.review)
        self._topics.append(topic)
        return topic

    def _every(
        self, rate: float, what: str, action: Callable[[int], None], topic: Topic, by_transforms: bool = False
    ) -> None:
        """Has ``action`` run while somebody subscribes to ``topic``, or to the transforms that it makes as well."""

        def wanted() -> bool:
            return topic.wanted or (by_transforms and self._transforms.wanted)

        rate = rate if rate > 0 else 1.0 / self._simulation.physics.step
        self._tasks.append(self._schedule.add(f"{self._entity.name}: {what}", rate, action, wanted))

    def _frame(self, frame: str) -> str:
        return resolved(self._prefix, frame)

    def _drive(self, driven: Driven) -> None:
        config = driven.drive.config
        topic = self._topic(config.odometryTopic, OdometryMessage)
        odom, base = self._frame(config.odometryFrame), self._frame(config.robotBaseFrame)
        template = conversions.OdometryTemplate(odom, base, conversions.POSE_COVARIANCE)
        transform = conversions.TransformTemplate(odom, base)
        sends_transform = config.publishTf and config.publishOdomTF
        of_world = config.odometrySource == "world"

        def publish(tick: int) -> None:
            time = nanoseconds(tick)
            if of_world:
                pose, linear, angular = self._true_motion()
            else:
                state = self._simulation.odometry(driven)
                pose = conversions.planar_pose(state.x, state.y, state.yaw)
                linear, angular = (state.speed, 0.0, 0.0), (0.0, 0.0, state.turn)
            if topic.wanted:
                topic.send(template.fill(time, pose, linear, angular))
            if sends_transform and self._transforms.wanted:
                self._transforms.add(transform.fill(time, pose))

        self._every(config.updateRate, config.odometryTopic, publish, topic, sends_transform)
        name = config.commandTopic if config.commandTopic.startswith("/") else f"{self._base}/{config.commandTopic}"
        self._subscribers.append(
            rospy.Subscriber(name, Twist, self._command, callback_args=driven, queue_size=1, tcp_nodelay=True)
        )

    def _true_motion(self) -> tuple[Pose, Vector, Vector]:
        """Returns the base's pose in the world and its velocities in its own axes."""
        pose, velocity = self._simulation.pose(self._entity), self._simulation.velocity(self._entity)
        x, y, z, w = pose.rotation
        back = (-x, -y, -z, w)
        return pose, rotated(back, velocity.linear), rotated(back, velocity.angular)

    def _command(self, message: Twist, driven: Driven) -> None:
        try:
            driven.command(self._now(), message.linear.x, message.angular.z)
        except CommandError as error:
            rospy.logerr_throttle(1.0, f"{self._entity.name}: {error}; the one before holds")

    def _laser(self, mounted: Mounted) -> None:
        config = mounted.laser.config
        topic = self._topic(config.topic, LaserScan)
        template = conversions.ScanTemplate(config, self._frame(config.frame), mounted.laser.increment)

        def publish(tick: int) -> None:
            topic.send(template.fill(nanoseconds(tick), self._simulation.ranges(self._entity, mounted)))

        self._every(config.update_rate, config.topic, publish, topic)

    def _sonar(self, config: kinds.SonarSensor, mounted: Mounted) -> None:
        topic = self._topic(config.topic, Range)
        template = conversions.RangeTemplate(config, self._frame(config.frame))

        def publish(tick: int) -> None:
            nearest = float(self._simulation.ranges(self._entity, mounted).min())
            distance = min(max(nearest, config.min_range), config.max_range)
            topic.send(template.fill(nanoseconds(tick), distance))

        self._every(config.update_rate, config.topic, publish, topic)

    def _ground_truth(self, config: kinds.GroundTruth) -> None:
        topic = self._topic(config.topicName, OdometryMessage)
        variance = [config.gaussianNoise**2] * 6
        template = conversions.OdometryTemplate(stripped(config.frameName), self._frame(config.bodyName), variance)
        part, at = self._entity.body.part_of(config.bodyName)
        offset = Pose.from_rpy(*config.xyzOffset, *config.rpyOffset)
        noise = generator_for(0, self._entity.name, config.name)
        at_origin = part == 0 and at == IDENTITY
        as_it_is = offset == IDENTITY

        def publish(tick: int) -> None:
            pose = self._simulation.link_pose(self._entity, config.bodyName)
            velocity = self._simulation.velocity(self._entity, part)
            linear, angular = velocity.linear, velocity.angular
            if not at_origin:
                arm = rotated(pose.compose(at.inverse()).rotation, at.position)
                linear = _sum(linear, _cross(angular, arm))
            if config.gaussianNoise > 0:
                draws = noise.standard_normal(6) * config.gaussianNoise
                linear = _sum(linear, tuple(draws[:3]))
                angular = _sum(angular, tuple(draws[3:]))
            if not as_it_is:
                turned = offset.compose(Pose(rotation=pose.rotation)).rotation
                pose = Pose(_sum(pose.position, offset.position), turned)
            topic.send(template.fill(nanoseconds(tick), pose, linear, angular))

        self._every(config.updateRate, config.topicName, publish, topic)

    def _joint_states(self, config: kinds.JointStatePublisher) -> None:
        topic = self._topic(config.topicName, JointState)
        movable = [part.joint.name for part in self._entity.body.parts if part.joint is not None]
        names = [name for name in config.jointName if name in movable] or movable
        parts = [self._entity.body.joint_index(name) for name in names]
        template = conversions.JointStateTemplate(names)

        def publish(tick: int) -> None:
            topic.send(template.fill(nanoseconds(tick), self._simulation.joints(self._entity, parts)))

        self._every(config.updateRate, config.topicName, publish, topic)

    def _bumper(self, config: kinds.Bumper) -> None:
        topic = self._topic(config.bumperTopicName, ContactsState)
        part, _ = self._entity.body.part_of(config.link)
        message = ContactsState()
        message.header.frame_id = stripped(config.frameName)

        def publish(tick: int) -> None:
            contacts = [one for one in self._simulation.contacts(self._entity) if one.part == part and one.force > 0]
            if contacts:
                message.header.stamp = rospy.Time(*conversions.seconds_nanoseconds(nanoseconds(tick)))
                message.states = [self._contact_state(config, one) for one in contacts]
                topic.send(conversions.frame_of(message))

        self._every(config.update_rate, config.bumperTopicName, publish, topic)

    def _contact_state(self, config: kinds.Bumper, contact: Contact) -> ContactState:
        force = Wrench(Vector3(*(contact.force * part for part in contact.normal)), Vector3())
        own = f"{self._entity.name}::{config.link}::{config.collision or config.link}"
        return ContactState(
            info=f"depth {contact.depth:.4f} m, force {contact.force:.2f} N",
            collision1_name=own,
            collision2_name=self._simulation.touched_name(contact),
            wrenches=[force],
            total_wrench=force,
            contact_positions=[Vector3(*contact.position)],
            contact_normals=[Vector3(*contact.normal)],
            depths=[contact.depth],
        )


def _tf_prefix(base: str) -> str:
    """Returns ``tf_prefix`` of the namespace, or of one above it."""
    while True:
        value = rospy.get_param(f"{base}/tf_prefix", None)
        if value is not None:
            return str(value)
        if not base:
            return ""
        base = base.rpartition("/")[0]


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
