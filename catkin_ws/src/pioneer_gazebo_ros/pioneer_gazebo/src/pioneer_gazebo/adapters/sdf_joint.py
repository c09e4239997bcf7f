"""Reads SDF joints between a model's links."""

import math
from collections.abc import Mapping

from pioneer_gazebo.adapters.element import Element
from pioneer_gazebo.adapters.sdf_link import Scope
from pioneer_gazebo.core.joint import CONTINUOUS, FIXED, PRISMATIC, REVOLUTE, WORLD, Joint
from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector, conjugate, rotated

_OWN_FRAME = ("", "world", "__model__")


class Frames:
    """The named frames in one ``<world>`` or ``<model>``."""

    def __init__(self, parent: Element) -> None:
        self._named = {
            name: child
            for child in parent.children("link", "frame", "model", "joint", "include")
            if (name := child.attribute("name", "") or child.word("name", ""))
        }

    def pose(self, element: Element) -> Pose:
        """Returns the element's pose in its world or model.

        Raises:
            DescriptionError: the pose refers to an unknown name or, directly or indirectly, to itself.
        """
        return self._pose(element, ())

    def named(self, name: str, asker: Element) -> Pose:
        """Returns the pose of the frame, link, joint or model of that name.

        Raises:
            DescriptionError: the name is unknown; the error is located at ``asker``.
        """
        if name not in self._named:
            raise asker.error(f"there is no frame {name!r}")
        return self.pose(self._named[name])

    def _pose(self, element: Element, seen: tuple[str, ...]) -> Pose:
        pose = element.child("pose")
        own = element.placed()
        base = "" if pose is None else pose.attribute("relative_to", pose.attribute("frame", ""))
        if not base and element.tag == "frame":
            base = element.attribute("attached_to", "")
        if not base and element.tag == "joint":
            base = element.needed("child").text
        if base in _OWN_FRAME:
            return own
        if base in seen:
            raise element.error(f"poses refer to each other in a loop: {' → '.join((*seen, base))}")
        if base not in self._named:
            raise element.error(f"the pose is relative to unknown frame {base!r}")
        return self._pose(self._named[base], (*seen, base)).compose(own)


KINDS = (FIXED, REVOLUTE, PRISMATIC, CONTINUOUS)
UNLIMITED = 1e15
"""SDF writes ±1e16 for no limit."""


def joint_from_sdf(element: Element, links: Mapping[str, Pose], frames: Frames, scope: Scope) -> Joint:
    """Returns the joint of a ``<joint>`` element; an unsupported type becomes a fixed joint, with a note.

    Args:
        element: the ``<joint>``.
        links: each link's pose in the model.
        frames: the model's named frames.
        scope: of the file.

    Raises:
        DescriptionError: a value is invalid, or a link is unknown.
    """
    name, kind = element.attribute("name"), element.attribute("type")
    ends = [element.needed(tag).text.removeprefix("__model__::") for tag in ("parent", "child")]
    poses = {WORLD: IDENTITY, **links}
    for end in ends:
        if end not in poses:
            raise element.error(f"there is no link {end!r}")
    if kind not in KINDS:
        scope.notes.add(f"joint type {kind!r} is not supported: the links it connects are held together")
        kind = FIXED
    parent, child = ends
    own = element.child("pose")
    of_frame = own is not None and own.attribute("relative_to", own.attribute("frame", ""))
    at = frames.pose(element) if of_frame else poses[child].compose(element.placed())
    if kind == FIXED:
        return Joint(name, FIXED, parent, child, poses[parent].inverse().compose(at), offset=_offset(at, poses[child]))
    axis = element.needed("axis")
    lower, upper = _limits(axis, kind)
    if axis.number("dynamics/spring_stiffness", 0.0) != 0.0:
        scope.notes.add("<spring_stiffness> of a joint is not supported and left out")
    return Joint(
        name,
        CONTINUOUS if kind == REVOLUTE and math.isinf(lower) and math.isinf(upper) else kind,
        parent,
        child,
        poses[parent].inverse().compose(at),
        _axis(axis, at, frames, element),
        lower,
        upper,
        damping=axis.number("dynamics/damping", 0.0),
        friction=axis.number("dynamics/friction", 0.0),
        offset=_offset(at, poses[child]),
    )


def _offset(joint: Pose, child: Pose) -> Pose:
    return joint.inverse().compose(child)


def _limits(axis: Element, kind: str) -> tuple[float, float]:
    limit = axis.child("limit")
    if limit is None or kind == CONTINUOUS:
        return -math.inf, math.inf
    lower, upper = limit.number("lower", -math.inf), limit.number("upper", math.inf)
    if lower > upper:
        raise limit.error(f"lower {lower:g} is above upper {upper:g}")
    return (lower if lower > -UNLIMITED else -math.inf), (upper if upper < UNLIMITED else math.inf)


def _axis(element: Element, joint: Pose, frames: Frames, owner: Element) -> Vector:
    """Returns the axis in the joint frame. SDF 1.4 gives it in the model frame, 1.5 and 1.6 optionally."""
    xyz = element.child("xyz")
    vector = (0.0, 0.0, 1.0) if xyz is None else xyz.direction()
    named = "" if xyz is None else xyz.attribute("expressed_in", "")
    of_model = element.flag("use_parent_model_frame") or owner.version() == "1.4" or named == "__model__"
    if named and not of_model:
        vector = rotated(frames.named(named, owner).rotation, vector)
    if named or of_model:
        return rotated(conjugate(joint.rotation), vector)
    return vector
