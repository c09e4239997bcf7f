"""Reads Gazebo worlds and models: SDF 1.4 to 1.7."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pioneer_gazebo.world.element import Element, Notes
from pioneer_gazebo.world.element_table import note_unused
from pioneer_gazebo.world.joint import FIXED, WORLD, Joint, tree_of
from pioneer_gazebo.world.model import Collision, Link, Model, Plane, Visual, World
from pioneer_gazebo.world.plugin import Names, read_plugin
from pioneer_gazebo.world.pose import IDENTITY, Pose
from pioneer_gazebo.world.resource import content_of, file_of_uri
from pioneer_gazebo.world.robot import Device
from pioneer_gazebo.world.sdf_actor import actor_from_sdf
from pioneer_gazebo.world.sdf_link import Frames, Scope, joint_from_sdf, link_from_sdf
from pioneer_gazebo.world.sdf_population import places_from_sdf
from pioneer_gazebo.world.sensor import read_sensor

VERSIONS = ("1.4", "1.5", "1.6", "1.7")
DEEPEST_INCLUDE = 20
FASTEST = 1000.0
"""Maximum real-time factor of a world."""

_GROUND = Plane((0.0, 0.0, 1.0), (100.0, 100.0))
GROUND_PLANE = Model(
    "ground_plane",
    static=True,
    links=(
        Link(
            "link",
            collisions=(Collision("collision", IDENTITY, _GROUND),),
            visuals=(Visual("visual", IDENTITY, _GROUND),),
        ),
    ),
)
"""The model of ``model://ground_plane`` if the search path has no such model."""


def world_from_sdf(path: str | Path, model_path: Sequence[str | Path] = ()) -> World:
    """Returns the world in a ``.world`` or ``.sdf`` file. Invalid elements are ignored with a note.

    Args:
        path: the file.
        model_path: directories searched for ``model://NAME``, first match wins.

    Raises:
        DescriptionError: the file cannot be read, or is not a world.
    """
    return world_from_sdf_text(
        content_of(path), model_path, str(path), Path(path).resolve().parent, tolerant=True
    )


def world_from_sdf_text(
    text: str | bytes,
    model_path: Sequence[str | Path] = (),
    source: str = "SDF",
    directory: Path | None = None,
    tolerant: bool = False,
) -> World:
    """Returns the world in SDF text; a document with a single ``<model>`` gives a world with that model alone.

    Args:
        text: the XML.
        model_path: directories searched for ``model://NAME``, first match wins.
        source: name of the text in error messages.
        directory: base of relative paths; the working directory by default.
        tolerant: whether invalid elements are ignored with a note.

    Raises:
        DescriptionError: the text is not SDF or, unless ``tolerant``, has an invalid value.
    """
    models = [Path(folder).expanduser() for folder in model_path]
    scope = Scope(directory or Path.cwd(), models, Notes(), tolerant)
    root = _sdf(text, source, scope)
    world = root.child("world")
    if world is not None:
        return _world(world, scope)
    found = _lone_model(root, scope, 0)
    if found is None:
        raise root.error("holds neither <world> nor <model>")
    found = _without_planes(found, scope)
    return World(found.name, (found,), warnings=scope.notes.lines())


def _sdf(text: str | bytes, source: str, scope: Scope) -> Element:
    root = Element.from_text(text, source, scope.notes)
    if root.tag != "sdf":
        raise root.error("is not SDF: the root element must be <sdf>")
    version = root.attribute("version")
    if version not in VERSIONS:
        scope.notes.add(f"SDF version {version} is read as if it were {VERSIONS[-1]}")
    note_unused(root, scope.notes)
    return root


def _world(element: Element, scope: Scope) -> World:
    models: dict[str, Model] = {}
    frames = Frames(element)
    for child in element.children(*_MODELS, "population"):
        found: list[Model] = []
        with scope.leaving_out():
            found = _models(child, frames, scope)
        for model in found:
            if not model.links and model.script is None:
                child.note(scope.notes, "the model has no links and is left out")
                continue
            name = _unused(model.name, models, scope)
            models[name] = _without_planes(dataclasses.replace(model, name=name), scope)
    placed = []
    for model in models.values():
        with scope.leaving_out():
            placed.append(_posed_by_frames(model, element, frames))
    states = {
        state.attribute("name"): state
        for parent in element.children("state")
        for state in parent.children("model")
    }
    moved = tuple(_moved_by_state(model, states.get(model.name)) for model in placed)
    world = World(
        element.attribute("name", "default"),
        moved,
        _gravity(element),
        _real_time_factor(element, scope),
    )
    if scope.tolerant:
        _note_what_cannot_stand(element, world, scope.notes)
    return dataclasses.replace(world, warnings=scope.notes.lines())


def _models(child: Element, frames: Frames, scope: Scope) -> list[Model]:
    """Returns the models of a child of ``<world>``."""
    if child.tag == "population":
        return _population(child, frames, scope)
    model = _MODELS[child.tag](child, frames, scope)
    return [] if model is None else [model]


def _population(element: Element, frames: Frames, scope: Scope) -> list[Model]:
    """Returns the copies of a population's model, named as in Gazebo."""
    inner = element.child("model") or element.needed("include")
    model = _MODELS[inner.tag](inner, frames, scope)
    if model is None:
        return []
    copies = []
    for number, place in enumerate(places_from_sdf(element)):
        name = f"{model.name}_clone_{number}"
        pose = Pose(place.position, model.pose.rotation)
        copies.append(dataclasses.replace(model, name=name, pose=pose))
    return copies


def _real_time_factor(world: Element, scope: Scope) -> float | None:
    """Returns the real-time factor that ``<physics>`` asks for, with a note about its step; None if it asks for none.

    In Gazebo it is the product of step and update rate, and ``<real_time_factor>`` has no effect; an update rate of 0
    is as fast as possible. Here a factor beside such a rate holds.
    """
    physics = world.child("physics")
    given = ("max_step_size", "real_time_update_rate", "real_time_factor")
    if physics is None or not any(physics.child(tag) for tag in given):
        return None
    with scope.leaving_out():
        return _factor(physics, scope.notes)
    return None


def _factor(physics: Element, notes: Notes) -> float:
    step = physics.number("max_step_size", 0.001)
    rate = physics.number("real_time_update_rate", 1000.0)
    if step < 0 or rate < 0:
        raise physics.error(
            f"real-time factor must be 0 … {FASTEST:g}: neither step {step:g} nor update rate {rate:g} may be negative"
        )
    factor = step * rate
    if factor == 0.0:
        factor = physics.number("real_time_factor", 0.0)
    if not 0 <= factor <= FASTEST:
        raise physics.error(f"real-time factor must be 0 … {FASTEST:g} (got {factor:g})")
    if physics.child("max_step_size") is not None:
        notes.count(
            physics,
            f"<physics>: real-time factor {factor:g}; steps are the simulator's own, not {step:g} s (~physics_rate)",
        )
    return factor


_MODELS: dict[str, Callable[[Element, Frames, Scope], Model | None]] = {
    "model": lambda element, _, scope: _model(element, scope, 0),
    "actor": lambda element, _, scope: actor_from_sdf(element, scope),
    "include": lambda element, frames, scope: _include(element, frames, scope, 0),
}


def _note_what_cannot_stand(element: Element, world: World, notes: Notes) -> None:
    """Adds a note if a world has no collision shapes, or if all of its models would fall."""
    if world.models and not any(True for _ in world.collisions()):
        element.note(notes, "no model has a collision shape: robots fall, and lasers see nothing")
    elif any(not model.static and model.script is None for model in world.models) and not any(
        True for _ in world.collisions(static_only=True)
    ):
        element.note(notes, "no model is static and there is no ground plane: all models fall")


def _without_planes(model: Model, scope: Scope) -> Model:
    """Returns the model with its planes removed unless it is static; the engine cannot move planes."""
    if model.static:
        return model
    links = []
    for link in model.links:
        kept = tuple(one for one in link.collisions if not isinstance(one.shape, Plane))
        if len(kept) < len(link.collisions):
            scope.notes.add(
                f"a plane in model {model.name}, which is not static, is not supported and left out"
            )
        links.append(dataclasses.replace(link, collisions=kept))
    return dataclasses.replace(model, links=tuple(links))


def _unused(name: str, models: dict[str, Model], scope: Scope) -> str:
    if name not in models:
        return name
    number = next(n for n in range(len(models) + 1) if f"{name}_{n}" not in models)
    scope.notes.add(f"model name {name!r} is used more than once: the later ones are numbered")
    return f"{name}_{number}"


def _posed_by_frames(model: Model, world: Element, frames: Frames) -> Model:
    """Returns the model with its pose's ``relative_to`` resolved against the world's other models and frames."""
    for child in world.children("model"):
        if child.attribute("name", "") == model.name:
            return dataclasses.replace(model, pose=frames.pose(child))
    return model


def _gravity(world: Element) -> tuple[float, float, float]:
    """Returns gravity, which is in ``<world>`` since SDF 1.6 and in its ``<physics>`` before."""
    for element in (world.child("gravity"), world.child("physics/gravity")):
        if element is not None:
            return element.vector()
    return 0.0, 0.0, -9.81


def _moved_by_state(model: Model, state: Element | None) -> Model:
    """Returns the model with the poses of ``<state>``, from Gazebo's "save world", applied to it and its links."""
    if state is None:
        return model
    pose = state.placed() if state.child("pose") is not None else model.pose
    poses: dict[str, Pose] = {}
    for element in state.children("link"):
        if element.child("pose") is not None:
            poses[element.attribute("name")] = pose.inverse().compose(element.placed())
    if model.joints:
        return dataclasses.replace(model, pose=pose)
    links = tuple(
        dataclasses.replace(link, pose=poses.get(link.name, link.pose)) for link in model.links
    )
    return dataclasses.replace(model, pose=pose, links=links)


def _lone_model(root: Element, scope: Scope, depth: int) -> Model | None:
    """Returns the model or actor of a document without a world; None if there is none."""
    model, actor = root.child("model"), root.child("actor")
    if model is not None:
        return _model(model, scope, depth)
    return None if actor is None else actor_from_sdf(actor, scope)


def _model(element: Element, scope: Scope, depth: int) -> Model:
    name = element.attribute("name")
    frames = Frames(element)
    links: list[Link] = []
    joints: list[Joint] = []
    devices: list[Any] = []
    namespace = ""
    static = element.flag("static")
    for child in element.children():
        if child.tag == "link":
            with scope.leaving_out():
                links.append(link_from_sdf(child, frames.pose(child), scope, frames))
        elif child.tag == "joint":
            continue
        elif child.tag in ("model", "include"):
            nested = None
            with scope.leaving_out():
                nested = (
                    _model(child, scope, depth)
                    if child.tag == "model"
                    else _include(child, frames, scope, depth)
                )
            if nested is not None:
                nested = (
                    dataclasses.replace(nested, pose=frames.pose(child))
                    if child.tag == "model"
                    else nested
                )
                # Like sdformat, merges all content of a nested model, except its pose, into the outer model.
                static = static or nested.static
                inner = _flattened(nested)
                links += inner.links
                joints += inner.joints
                devices += inner.devices
                namespace = namespace or inner.namespace
    poses = {link.name: link.pose for link in links}
    for child in element.children("joint"):
        with scope.leaving_out():
            joints.append(joint_from_sdf(child, poses, frames, scope))
    tree, closing = tree_of(poses, joints) if joints and links else ((), ())
    for joint in closing:
        scope.notes.add(
            f"joint {joint} of model {name} closes a kinematic loop, which is not supported; it is ignored"
        )
    fixed = [joint.name for joint in joints if joint.kind == FIXED]
    moving = [joint.name for joint in joints if joint.kind != FIXED]
    devices += _devices(element, Names([link.name for link in links], moving, fixed), scope)
    for plugin in element.children("plugin"):
        namespace = namespace or plugin.word("robotNamespace", "").strip("/")
    if static and devices:
        scope.notes.add(
            f"sensors and plugins of model {name}, which is static, are not supported and ignored"
        )
        devices = []
    return Model(
        name, element.placed(), static, tuple(links), None, tree, tuple(devices), namespace
    )


def _devices(element: Element, names: Names, scope: Scope) -> list[Device]:
    """Returns the sensors and plugins of a model's own links."""
    devices: list[Device] = []
    for link in element.children("link"):
        for sensor in link.children("sensor"):
            with scope.leaving_out():
                devices += read_sensor(sensor, link.attribute("name"), scope.notes)
    for plugin in element.children("plugin"):
        with scope.leaving_out():
            devices += read_plugin(plugin, names, scope.notes)
    return devices


NAMING = (
    "link",
    "bodyName",
    "leftJoint",
    "rightJoint",
    "leftRearJoint",
    "rightRearJoint",
    "jointName",
    "joint",
    "mimicJoint",
)
"""Fields of devices that hold link or joint names."""


def _flattened(nested: Model) -> Model:
    """Returns a nested model with its parts in the outer model's frame, named ``nested::link`` as in Gazebo."""

    def outer(name: str) -> str:
        return name if name == WORLD else f"{nested.name}::{name}"

    links = [
        dataclasses.replace(link, name=outer(link.name), pose=nested.pose.compose(link.pose))
        for link in nested.links
    ]
    joints = [
        dataclasses.replace(
            joint,
            name=outer(joint.name) if joint.name else "",
            parent=outer(joint.parent),
            child=outer(joint.child),
            pose=nested.pose.compose(joint.pose) if joint.parent == WORLD else joint.pose,
        )
        for joint in nested.joints
    ]
    devices = []
    for device in nested.devices:
        given = {name: getattr(device, name) for name in NAMING if hasattr(device, name)}
        named = {
            key: tuple(map(outer, at)) if isinstance(at, tuple) else outer(at)
            for key, at in given.items()
        }
        devices.append(dataclasses.replace(device, **named))
    return dataclasses.replace(
        nested, links=tuple(links), joints=tuple(joints), devices=tuple(devices)
    )


def _include(element: Element, frames: Frames, scope: Scope, depth: int) -> Model | None:
    """Returns the model of an ``<include>``; None if it has no body or, with a note, if it is not found."""
    uri = element.needed("uri")
    if depth >= DEEPEST_INCLUDE:
        raise element.error(
            f"includes are nested deeper than {DEEPEST_INCLUDE}: does {uri.text} include itself?"
        )
    path = file_of_uri(uri.text, scope.directory, scope.models)
    if path is not None:
        model = _model_from_directory(path, uri, scope, depth + 1)
    elif uri.text == "model://ground_plane":
        model = GROUND_PLANE
    else:
        if uri.text != "model://sun":
            scope.notes.add(f"{uri.text} is not found along the model path and left out")
        return None
    return None if model is None else _overridden(model, element, frames)


def _overridden(model: Model, include: Element, frames: Frames) -> Model:
    pose = include.child("pose")
    if model.script is not None and pose is not None and pose.text:
        return dataclasses.replace(
            model.moved(frames.pose(include)), name=include.word("name", model.name)
        )
    return dataclasses.replace(
        model,
        name=include.word("name", model.name),
        pose=model.pose if pose is None or not pose.text else frames.pose(include),
        static=include.flag("static", model.static),
    )


def _model_from_directory(path: Path, uri: Element, scope: Scope, depth: int) -> Model | None:
    file = model_file(path, scope.notes) if path.is_dir() else path
    inner = dataclasses.replace(scope, directory=file.parent)
    root = _sdf(content_of(file), str(file), inner)
    model = _lone_model(root, inner, depth)
    if model is not None:
        return model
    if root.child("light") is not None:
        return None
    raise uri.error(f"{file} holds no <model>")


def model_file(directory: Path, notes: Notes) -> Path:
    """Returns the file with the newest supported version in ``model.config``, or ``model.sdf``."""
    manifest = directory / "model.config"
    if not manifest.is_file():
        return directory / "model.sdf"
    named = list(Element.from_text(content_of(manifest), str(manifest), notes).children("sdf"))
    known = [
        element for element in named if element.attribute("version", VERSIONS[0]) in VERSIONS
    ] or named
    if not known:
        return directory / "model.sdf"
    return (
        directory / max(known, key=lambda element: element.attribute("version", VERSIONS[0])).text
    )
