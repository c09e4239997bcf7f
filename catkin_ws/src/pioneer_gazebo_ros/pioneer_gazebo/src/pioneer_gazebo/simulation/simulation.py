"""The running simulation: bodies, drives, lasers and collisions, on top of a physics engine.

Time is counted in ticks (see `schedule`). A physics step takes several ticks. The state at a tick between two steps is
interpolated: poses, velocities, joints, odometry. So sensors can have any rate. The engine may therefore be ahead of
the current tick by less than a step, and commands take effect from the next step on.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.body.body import Body, body_from_model, body_from_robot
from pioneer_gazebo.error import ModelError, SimulatorError
from pioneer_gazebo.noise import Noise
from pioneer_gazebo.physics import bound
from pioneer_gazebo.physics.engine import STILL, Contact, Engine, JointReading, Physics, Velocity
from pioneer_gazebo.simulation.actor import Actors, Effort, Wrench, Wrenches
from pioneer_gazebo.simulation.command import Moment
from pioneer_gazebo.simulation.drive import Odometry
from pioneer_gazebo.simulation.entity import (
    CollisionCounter,
    Driven,
    Earlier,
    Entity,
    Mounted,
    carry,
    control,
    equip,
    noise_of,
)
from pioneer_gazebo.simulation.motion import (
    JointState,
    Motion,
    chain_to,
    interpolated,
    part_motion,
)
from pioneer_gazebo.simulation.noise_profile import DESCRIBED, NoiseProfile
from pioneer_gazebo.simulation.scene import Scene, Seen
from pioneer_gazebo.simulation.schedule import TICK_RATE, period_of
from pioneer_gazebo.simulation.spot import added
from pioneer_gazebo.simulation.standing import Standing
from pioneer_gazebo.world.model import Model, World
from pioneer_gazebo.world.pose import Pose, Vector, between, opposite, rotated
from pioneer_gazebo.world.robot import Device, Robot
from pioneer_gazebo.world.section import Triangles

LONGEST_NAME = 200
"""Maximum length of a model name [characters]."""


@contextmanager
def _collected(lines: list[str]) -> Iterator[None]:
    """Turns a SimulatorError raised in the block into a line that the model is left out."""
    try:
        yield
    except SimulatorError as error:
        lines.append(f"{error}; the model is left out")


def _base_velocity(entity: Entity, earlier: Earlier) -> Velocity:
    """Returns the velocity of the base frame before the last step."""
    centre = entity.body.parts[0].inertia.pose.position
    return earlier.velocity.at(opposite(rotated(entity.before.rotation, centre)))


class Simulation:
    """The simulation. Used from one thread."""

    def __init__(
        self, engine: Engine, triangles: Triangles, physics: Physics, seed: int = 0,
        odometry_error: float = 0.0, odometry_scale: float = 1.0, noise: NoiseProfile = DESCRIBED,
    ) -> None:  # fmt: skip
        """Starts an empty world at tick 0.

        Args:
            engine: the physics engine.
            triangles: reads meshes.
            physics: engine settings; the step must be an integer number of ticks.
            seed: of all noise.
            odometry_error: standard deviation of the wheel diameters assumed by odometry, relative to the diameter.
            odometry_scale: mean ratio of assumed to true wheel diameter.
            noise: least noise of every robot.
        """
        self._engine = engine
        self._triangles = triangles
        self._scene = Scene(triangles)
        self._seed, self._odometry_error, self._odometry_scale = (
            seed,
            odometry_error,
            odometry_scale,
        )
        self._noise = noise
        self._entities: dict[str, Entity] = {}
        self._by_handle: dict[int, Entity] = {}
        self._standing = Standing(engine, self._scene, triangles)
        self._actors = Actors(engine)
        self._wrenches = Wrenches(engine)
        self._collided: list[Entity] = []
        self._lost: dict[str, Pose] = {}
        self.spawn_search = 0.5  # maximum shift [m] of a robot that would overlap something static
        self.epoch = 0  #: how often time has restarted
        self.tick = self._stepped = self._inspected = 0
        self._part = 1.0
        self._period = 1  # of a step [ticks]
        self._span = 1  # of the last step, which may have had another period [ticks]
        self.physics = physics
        self.configure(physics)

    def configure(self, physics: Physics) -> None:
        """Applies new engine settings.

        Raises:
            RateError: the step is not an integer number of ticks.
            BoundError: gravity or solver iterations out of bounds.
        """
        bound.check_physics(physics)
        self._period = period_of(
            1.0 / physics.step if physics.step > 0 else 0.0, "the physics step"
        )
        self.physics = physics
        self._engine.configure(physics)

    def load(self, world: World) -> list[str]:
        """Adds the models of a world; returns a line for each that cannot be simulated and is left out."""
        static = [model for model in world.models if model.static]
        refused: list[str] = []
        try:
            self._standing.add(*static)
        except SimulatorError:
            # One by one takes long in a large world, so only if a model is invalid.
            for model in static:
                with _collected(refused):
                    self._standing.add(model)
        for model in world.models:
            if not model.static:
                with _collected(refused):
                    self.add_model(model, anywhere=True)
        return refused

    # Models.

    def names(self) -> list[str]:
        """Returns the names of all models."""
        return [*self._standing.models, *self._entities]

    def entities(self) -> Iterator[Entity]:
        """Yields all moving entities in the order of spawning."""
        yield from self._entities.values()

    def entity(self, name: str) -> Entity:
        """Returns the moving entity of that name.

        Raises:
            ModelError: there is none.
        """
        found = self._entities.get(name)
        if found is None:
            raise ModelError(
                f"model {name} {'is static' if name in self._standing.models else 'does not exist'}"
            )
        return found

    @property
    def standing(self) -> Mapping[str, Model]:
        """The static models by name."""
        return self._standing.models

    def add_model(self, model: Model, namespace: str = "", anywhere: bool = False) -> None:
        """Adds a model without sensors and plugins; ``anywhere`` allows overlaps, as for the models of a world file.

        Raises:
            ModelError: its name is taken, or it would overlap something.
            EngineError: a shape cannot be created.
        """
        self._check_name(model.name)
        if model.static:
            self._standing.add(model)
            return
        if not model.links:
            raise ModelError(f"model {model.name} has no links")
        body = body_from_model(model, self._triangles)
        namespace = namespace or model.namespace
        if model.script is None:
            robot = (
                Robot(model.name, model.links, model.joints, model.devices)
                if model.devices
                else None
            )
            self._add(model.name, namespace, body, model.pose, robot, anywhere)
            return
        pose = model.script.pose(0.0)
        entity = Entity(model.name, namespace, body, self._engine.add(body, pose), pose, after=pose)
        self._actors.add(self._keep(entity), model.script, self._stepped)

    def add_robot(self, name: str, namespace: str, robot: Robot, pose: Pose) -> Entity:
        """Adds a robot with its root link at ``pose``.

        Raises:
            ModelError: its name is taken, or it would overlap something.
            DescriptionError, CommandError, EngineError: its description cannot be simulated.
        """
        self._check_name(name)
        body = body_from_robot(robot, self._triangles)
        return self._add(name, namespace, body, pose, robot, anywhere=False)

    def _check_name(self, name: str) -> None:
        """Raises ModelError if the name is invalid or in use."""
        if not name or len(name) > LONGEST_NAME:
            raise ModelError(
                f"a model's name needs 1 to {LONGEST_NAME} characters, this has {len(name)}"
            )
        if name in self._entities or name in self._standing.models:
            raise ModelError(f"model {name} already exists")

    def _add(
        self, name: str, namespace: str, body: Body, pose: Pose, robot: Robot | None, anywhere: bool
    ) -> Entity:
        bound.check_body(body)
        bound.check_pose(pose)
        search = self.spawn_search if robot is not None else 0.0
        found = added(self._engine, body, pose, self._triangles, anywhere, search)
        if isinstance(found, Contact):
            x, y, _ = pose.position
            inside = self.touched_name(found)
            raise ModelError(
                f"model {name} at ({x:.2f}, {y:.2f}) would overlap {inside} by {found.depth:.2f} m"
            )
        handle, pose = found
        entity = self._keep(Entity(name, namespace, body, handle, pose, robot, after=pose))
        try:
            equip(entity, self._seed, self._odometry_error, self._odometry_scale, self._noise)
        except SimulatorError:
            self.remove(name)
            raise
        for driven in entity.drives:
            driven.turn(self._engine, (0.0, 0.0))
        return entity

    def _keep(self, entity: Entity) -> Entity:
        entity.before, entity.seen = entity.after, self._stepped
        entity.number = len(self._entities)
        self._entities[entity.name] = self._by_handle[entity.handle] = entity
        self._scene.add(entity)
        return entity

    def remove(self, name: str) -> None:
        """Removes a model.

        Raises:
            ModelError: there is no model of that name.
        """
        if name in self._standing.models:
            self._standing.remove(name)
            return
        entity = self.entity(name)
        self._engine.remove(entity.handle)
        self._scene.remove(entity)
        del self._entities[name], self._by_handle[entity.handle]
        for number, other in enumerate(self._entities.values()):
            other.number = number
        self._lost.pop(name, None)
        self._actors.remove(entity)
        self._wrenches.clear(entity)
        self._collided = [one for one in self._collided if one is not entity]

    # Time.

    @property
    def moment(self) -> Moment:
        """The current time, with which the owner's thread stamps commands."""
        return Moment(self.epoch, self.tick)

    def advance(self, tick: int) -> None:
        """Advances to ``tick`` in as many physics steps as necessary."""
        while self._stepped < tick:
            if tick <= self._stepped + self._period:
                self._remember(between=tick < self._stepped + self._period)
            self._step()
        self.tick = tick
        self._part = 1.0 - (self._stepped - tick) / self._span

    def _remember(self, between: bool) -> None:
        """Keeps what is needed of the state before a step; ``between``: states between it and the next are read."""
        for entity in self._entities.values():
            if between or entity.needs_acceleration:
                entity.before = self._settled(entity)
            if entity.needs_acceleration or (between and entity.needs_motion):
                entity.earlier = Earlier(
                    tick=self._stepped,
                    velocity=self._engine.centre_velocity(entity.handle),
                    joints=self._joints(entity),
                )

    def _step(self) -> None:
        step = self.physics.step
        now = Moment(self.epoch, self._stepped)
        self._wrenches.push(self._stepped, self._stepped + self._period)
        for entity in self._entities.values():
            control(self._engine, entity, now, step)
            if entity.is_weightless:
                carry(self._engine, entity, self.physics.gravity)
        self._actors.lead(self._stepped + self._period, step)
        self._engine.step()
        self._stepped += self._period
        self._span = self._period
        for entity in self._entities.values():
            for driven in entity.drives:
                driven.before = driven.drive.odometry
                driven.drive.measure(*driven.angles(self._joints(entity)), step)
        self._actors.follow(self._stepped)
        time = self._stepped / TICK_RATE
        for handle in sorted(self._engine.touching()):
            entity = self._by_handle[handle]
            if entity.collisions.touched(time):
                self._collided.append(entity)

    def collided(self) -> list[Entity]:
        """Returns the entities that started to touch something since the last call."""
        collided, self._collided = self._collided, []
        return collided

    # States at the current tick.

    def _settled(self, entity: Entity) -> Pose:
        """Returns the pose of the base frame after the last step, querying the engine once per step."""
        if entity.seen != self._stepped:
            pose = self._engine.pose(entity.handle)
            if bound.is_sound(pose):
                entity.after = pose
            else:
                self._lost[entity.name] = pose
            entity.seen = self._stepped
        return entity.after

    def _joints(self, entity: Entity) -> Sequence[JointReading]:
        """Returns the joint of each part but the base after the last step, querying the engine once per step."""
        if entity.joints_seen != self._stepped:
            entity.joints = self._engine.joints(entity.handle, range(1, len(entity.body.parts)))
            entity.joints_seen = self._stepped
        return entity.joints

    def lost(self) -> list[str]:
        """Returns the names of models that have left the world's bounds or whose state is not finite."""
        if self._stepped - self._inspected >= TICK_RATE:
            self._inspected = self._stepped
            for entity in self._entities.values():
                self._settled(entity)
        return list(self._lost)

    def pose(self, entity: Entity) -> Pose:
        """Returns the pose of the base frame."""
        after = self._settled(entity)
        return after if self._part >= 1.0 else between(entity.before, after, self._part)

    def link_pose(self, entity: Entity, link: str) -> Pose:
        """Returns the pose of a link's frame.

        Raises:
            KeyError: there is no such link.
        """
        part, at = entity.body.part_of(link)
        return self.part_pose(entity, part).compose(at)

    def part_pose(self, entity: Entity, part: int) -> Pose:
        """Returns the pose of a part's frame."""
        if part == 0:
            return self.pose(entity)
        if self._part >= 1.0:
            return self._engine.pose(entity.handle, part)
        return self._part_between(entity, part).pose

    def part_poses(self, entity: Entity) -> list[Pose]:
        """Returns the pose of each part's frame."""
        return [self.part_pose(entity, number) for number in range(len(entity.body.parts))]

    def velocity(self, entity: Entity, part: int = 0) -> Velocity:
        """Returns the velocity of a part's frame."""
        if entity.script is not None:
            return entity.motion
        if self._part >= 1.0:
            return self._engine.velocity(entity.handle, part)
        return self._part_between(entity, part).velocity

    def _part_between(self, entity: Entity, part: int) -> Motion:
        """Returns a part's motion at a tick between two steps."""
        velocity = self._engine.velocity(entity.handle)
        earlier = self._earlier(entity)
        if earlier is not None:
            velocity = interpolated(_base_velocity(entity, earlier), velocity, self._part)
        chain = chain_to(entity.body, part)
        joints = self.joints(entity, chain)
        return part_motion(entity.body, chain, Motion(self.pose(entity), velocity), joints)

    def _earlier(self, entity: Entity) -> Earlier | None:
        """Returns the velocities before the last step; None if they are not known, as after a jump."""
        earlier = entity.earlier
        if earlier is None or earlier.tick != self._stepped - self._span:
            return None
        return earlier

    def acceleration(self, entity: Entity, link: str) -> Vector:
        """Returns the acceleration of a link's frame in the world [m/s²], constant during a step.

        Known for a robot with an inertial unit; 0 in the step in which it was spawned or moved.

        Raises:
            KeyError: there is no such link.
        """
        part, at = entity.body.part_of(link)
        earlier = self._earlier(entity)
        if earlier is None:
            return (0.0, 0.0, 0.0)
        chain = chain_to(entity.body, part)
        joints = self._joints(entity)
        now = [JointState(*joints[number - 1]) for number in chain]
        seconds = self._span / TICK_RATE
        then = [
            JointState(state.position - seconds * state.rate, earlier.rate(number))
            for number, state in zip(chain, now, strict=True)
        ]
        base = Motion(self._settled(entity), self._engine.velocity(entity.handle))
        base_then = Motion(entity.before, _base_velocity(entity, earlier))
        speeds = []
        for motion in (
            part_motion(entity.body, chain, base_then, then),
            part_motion(entity.body, chain, base, now),
        ):
            arm = rotated(motion.pose.rotation, at.position)
            speeds.append(motion.velocity.at(arm).linear)
        (ax, ay, az), (bx, by, bz) = speeds
        return (bx - ax) / seconds, (by - ay) / seconds, (bz - az) / seconds

    def odometry(self, driven: Driven) -> Odometry:
        """Returns the wheel odometry."""
        now = driven.drive.odometry
        return now if self._part >= 1.0 else driven.before.towards(now, self._part)

    def joints(self, entity: Entity, parts: Sequence[int]) -> list[JointState]:
        """Returns the states of the joints that move ``parts``."""
        joints = self._joints(entity)
        states = [JointState(*joints[part - 1]) for part in parts]
        if self._part >= 1.0:
            return states
        # A step moves a joint by its speed after the step.
        left = (1.0 - self._part) * self._span / TICK_RATE
        positions = [state.position - left * state.rate for state in states]
        rates = [state.rate for state in states]
        earlier = self._earlier(entity)
        if earlier is not None:
            befores = [earlier.rate(part) for part in parts]
            rates = [
                before + self._part * (rate - before)
                for before, rate in zip(befores, rates, strict=True)
            ]
        return [JointState(*state) for state in zip(positions, rates, strict=True)]

    def efforts(self, entity: Entity, parts: Sequence[int]) -> list[float]:
        """Returns the efforts applied in the last step by the motors of the joints that move ``parts`` [N m or N]."""
        return self._engine.efforts(entity.handle, parts)

    def contacts(self, entity: Entity) -> list[Contact]:
        """Returns the entity's contacts, except those that support it."""
        return self._engine.contacts(entity.handle)

    def touched_name(self, contact: Contact) -> str:
        """Returns ``model::link::collision`` of the other side of a contact."""
        if contact.other is not None:
            return self._by_handle[contact.other].touch_name(contact.other_part)
        return self._standing.name_at(contact.position)

    def ranges(self, entity: Entity, mounted: Mounted) -> NDArray[np.float64]:
        """Returns a scan's ranges [m]; the array is overwritten by the laser's next scan."""
        return mounted.laser.measured(self._distances(entity, mounted), self.tick)

    def _distances(self, entity: Entity, mounted: Mounted) -> NDArray[np.float64]:
        """Returns the true distance along each beam [m]."""
        sensor = self.part_pose(entity, mounted.part).compose(mounted.pose)
        if self._scene.tick != self.tick:
            self._scene.update(self.tick, self._seen())
        upright = self._upright(entity, mounted, sensor)
        return self._scene.distances(sensor, mounted, entity.number, upright)

    def _upright(self, entity: Entity, mounted: Mounted, sensor: Pose) -> float:
        """Returns the z component of a ray sensor's axis in the robot's base frame, at the joints' positions."""
        if mounted.part == 0:
            return mounted.upright
        up, axis = (
            rotated(rotation, (0.0, 0.0, 1.0))
            for rotation in (self.pose(entity).rotation, sensor.rotation)
        )
        return sum(a * b for a, b in zip(up, axis, strict=True))

    def _seen(self) -> list[Seen]:
        """Returns the outline and the pose of all that lasers see: of the entities, then of swinging parts."""
        seen = [(other.outline, self.pose(other)) for other in self._entities.values()]
        swinging = [
            (one.outline, self.part_pose(one.entity, one.part)) for one in self._scene.swinging
        ]
        return seen + swinging

    def distance(self, entity: Entity, mounted: Mounted) -> float:
        """Returns a sonar's reading [m]: the distance to the nearest hit in its cone, within its limits."""
        return mounted.laser.nearest(self._distances(entity, mounted), self.tick)

    def noise(self, entity: Entity, device: Device) -> Noise:
        """Returns the noise of a robot's device."""
        return noise_of(entity, device, self._seed)

    # Actions.

    def place(self, name: str, pose: Pose, velocity: Velocity | None = None) -> None:
        """Moves a model instantly; if ``velocity`` is None, it keeps its velocity.

        Raises:
            ModelError: there is no model of that name, or it follows a script.
            BoundError: a value is out of bounds.
        """
        bound.check_pose(pose)
        bound.check_velocity(velocity or STILL)
        if name in self._standing.models:
            self._standing.place(name, pose)
            return
        entity = self.entity(name)
        if entity.script is not None:
            raise ModelError(f"model {name} follows its script and cannot be placed")
        self._engine.set_pose(entity.handle, pose)
        if velocity is not None:
            self._engine.set_velocity(entity.handle, velocity)
        entity.before, entity.after, entity.seen = pose, pose, self._stepped
        entity.earlier = None
        self._scene.outdate()

    def set_joint(self, entity: Entity, joint: str, position: float) -> None:
        """Sets a joint to a position [rad or m], at rest.

        Raises:
            KeyError: there is no such joint, or it is fixed.
        """
        bound.check("joint position", (position,), bound.FARTHEST, "")
        part = entity.body.joint_index(joint)
        self._engine.set_joint(entity.handle, part, position)
        entity.earlier = None
        entity.joints_seen = -1
        for driven in entity.drives:
            driven.moved_joint(part, self._joints(entity))
        self._scene.outdate()

    def push(self, wrench: Wrench | Effort) -> None:
        """Applies a push for its duration, from the next step on; raises BoundError if it is out of bounds."""
        if isinstance(wrench, Effort):
            bound.check("effort", (wrench.effort,), bound.STRONGEST, "N m or N")
        else:
            bound.check_wrench(wrench.force, wrench.torque, wrench.point or (0.0, 0.0, 0.0))
        late = max(0.0, self._stepped - wrench.first)
        self._wrenches.add(replace(wrench, first=wrench.first + late, last=wrench.last + late))

    def clear_pushes(self, kind: type[Wrench | Effort], entity: Entity, part: int) -> None:
        """Ends all wrenches on a part, or all efforts of the joint that moves it."""
        self._wrenches.clear_part(kind, entity, part)

    def reset_poses(self) -> None:
        """Returns every model to its initial pose, at rest, with odometry at the origin. Time continues."""
        self._standing.reset()
        self._wrenches.clear()
        self._actors.restart(self._stepped)
        self._scene.outdate()
        for entity in (one for one in self._entities.values() if one.script is None):
            self.place(entity.name, entity.initial, STILL)
            for part, one in enumerate(entity.body.parts):
                if one.joint is not None:
                    self._engine.set_joint(entity.handle, part, 0.0)
            entity.joints_seen = -1
            for driven in entity.drives:
                driven.reset()
                driven.turn(self._engine, (0.0, 0.0))
            for mover in entity.movers:
                mover.reset()
            for motor in entity.motors:
                motor.reset()

    def reset(self) -> None:
        """Does `reset_poses`, and resets time, with it noise, and collision counts."""
        self.tick = self._stepped = self._inspected = 0
        self.reset_poses()
        self._part = 1.0
        self._span = self._period
        self._collided.clear()
        for entity in self._entities.values():
            entity.seen = 0
            entity.joints_seen = -1
            entity.earlier = None
            entity.collisions = CollisionCounter()
        # Last: a thread that reads the new epoch reads the new time, too.
        self.epoch += 1
