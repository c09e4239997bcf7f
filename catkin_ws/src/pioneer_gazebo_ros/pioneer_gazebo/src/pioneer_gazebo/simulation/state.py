"""States of models and links by their Gazebo names, ``model`` and ``model::link``."""

from pioneer_gazebo.error import ModelError
from pioneer_gazebo.physics.engine import STILL, Velocity
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.pose import (
    IDENTITY,
    Pose,
    Vector,
    added,
    cross,
    opposite,
    rotated,
)

WORLD_NAMES = ("", "world", "map", "/map", "/world")


def split_name(simulation: Simulation, name: str) -> tuple[str, str]:
    """Splits ``model::link`` into model and link; the link is empty if only a model is named.

    Names of models and links may contain ``::``, too: the longest beginning that names a model is the model.
    """
    names = set(simulation.names())
    words = name.split("::")
    for count in range(len(words), 0, -1):
        model = "::".join(words[:count])
        if model in names:
            return model, "::".join(words[count:])
    model, _, link = name.partition("::")
    return model, link


def links_of(simulation: Simulation, model: str) -> list[str]:
    """Returns the names of a model's links.

    Raises:
        ModelError: there is no such model.
    """
    standing = simulation.standing.get(model)
    if standing is not None:
        return [link.name for link in standing.links]
    return [name for part in simulation.entity(model).body.parts for name, _ in part.frames]


def link_motion(simulation: Simulation, model: str, link: str = "") -> tuple[Pose, Velocity]:
    """Returns pose and velocity of a link, or of the model itself without ``link``, in the world.

    Raises:
        ModelError: there is no such model or link.
    """
    standing = simulation.standing.get(model)
    if standing is not None:
        if not link:
            return standing.pose, STILL
        for one in standing.links:
            if one.name == link:
                return standing.pose.compose(one.pose), STILL
        raise ModelError(f"model {model} has no link {link}")
    entity = simulation.entity(model)
    if not link:
        return simulation.pose(entity), simulation.velocity(entity)
    part, at = part_of(entity, link)
    pose = simulation.link_pose(entity, link)
    arm = rotated(pose.compose(at.inverse()).rotation, at.position)
    return pose, simulation.velocity(entity, part).at(arm)


def part_of(entity: Entity, link: str) -> tuple[int, Pose]:
    """Returns the part that contains a link, and the link's pose in it.

    Raises:
        ModelError: there is no such link.
    """
    try:
        return entity.body.part_of(link)
    except KeyError:
        raise ModelError(f"model {entity.name} has no link {link}") from None


def motion(simulation: Simulation, name: str) -> tuple[Pose, Velocity]:
    """Returns pose and velocity of a model, of a link (``model::link``), or of the world itself.

    A model that is called ``world`` or ``map`` cannot be used as a frame of reference.

    Raises:
        ModelError: there is no model or link of that name.
    """
    if name in WORLD_NAMES:
        return IDENTITY, STILL
    return link_motion(simulation, *split_name(simulation, name))


def relative(simulation: Simulation, name: str, reference: str) -> tuple[Pose, Velocity]:
    """Returns pose and velocity of ``name`` relative to ``reference``.

    Raises:
        ModelError: there is no model or link of either name.
    """
    if name in simulation.names():
        pose, velocity = link_motion(simulation, name)
    else:
        pose, velocity = motion(simulation, name)
    return seen_from(pose, velocity, *motion(simulation, reference))


def seen_from(
    pose: Pose, velocity: Velocity, base: Pose, base_velocity: Velocity
) -> tuple[Pose, Velocity]:
    """Returns pose and velocity in the axes of a frame ``base`` that moves with ``base_velocity``.

    As in Gazebo, the difference of velocities leaves out the frame's rotation.
    """
    linear = added(velocity.linear, opposite(base_velocity.linear))
    angular = added(velocity.angular, opposite(base_velocity.angular))
    return base.inverse().compose(pose), Velocity(linear, angular).seen_from(base.rotation)


def wrench(
    simulation: Simulation, body: str, reference: str, point: Vector, force: Vector, torque: Vector
) -> tuple[Vector, Vector]:
    """Returns force and torque on a body's centre of mass in the world's axes, as gazebo_ros computes them.

    A ``point`` adds the torque of the force about it. In a frame other than the world's, the arm from the body to that
    frame adds its torque, too; in the world's frame the point is relative to the body.

    Args:
        simulation: the simulation.
        body: ``model::link``.
        reference: the frame of the other arguments.
        point: at which the force acts [m].
        force: [N].
        torque: [N m].

    Raises:
        ModelError: there is no model or link of either name.
    """
    base, _ = motion(simulation, reference)
    turned = rotated(base.rotation, force)
    moment = rotated(base.rotation, added(torque, cross(point, force)))
    if reference not in WORLD_NAMES:
        pose, _ = motion(simulation, body)
        arm = added(base.position, opposite(pose.position))
        moment = added(moment, cross(arm, turned))
    return turned, moment


def place(
    simulation: Simulation, name: str, pose: Pose, velocity: Velocity, reference: str
) -> None:
    """Moves a model so that it, or its link, has this pose and velocity relative to ``reference``.

    Raises:
        ModelError: there is no model or link of either name.
    """
    model, link = split_name(simulation, name)
    base, _ = motion(simulation, reference)
    wanted = base.compose(pose)
    if link:
        link_from_model = (
            link_motion(simulation, model, link)[0]
            .inverse()
            .compose(link_motion(simulation, model)[0])
        )
        wanted = wanted.compose(link_from_model)
    turned = Velocity(
        rotated(base.rotation, velocity.linear), rotated(base.rotation, velocity.angular)
    )
    simulation.place(model, wanted, turned)
