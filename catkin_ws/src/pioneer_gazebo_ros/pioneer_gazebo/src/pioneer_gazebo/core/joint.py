"""Joints between links, and how links and joints make one tree."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from pioneer_gazebo.core.pose import IDENTITY, Pose, Vector

FIXED, CONTINUOUS, REVOLUTE, PRISMATIC, FLOATING = "fixed", "continuous", "revolute", "prismatic", "floating"

WORLD = "world"
"""The link that SDF joints name to hold a model where it stands."""


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint between two links."""

    name: str  #: unique in the robot or model
    kind: str  #: fixed, continuous, revolute, prismatic or floating
    parent: str  #: name of the link towards the root
    child: str  #: name of the link that this joint moves
    pose: Pose = IDENTITY  #: of the joint's frame in the parent's frame, at position 0
    axis: Vector = (1.0, 0.0, 0.0)  #: unit vector in the joint's frame
    lower: float = float("-inf")  #: smallest position [rad or m]; -inf where there is no limit
    upper: float = float("inf")  #: largest position
    effort: float = float("inf")  #: largest force or torque [N or N m]; inf where there is none
    velocity: float = float("inf")  #: largest speed [rad/s or m/s]
    damping: float = 0.0  #: [N m s/rad or N s/m]
    friction: float = 0.0  #: static friction [N m or N]
    offset: Pose = IDENTITY  #: of the child's frame in the joint's frame; URDF has none

    def reversed(self) -> "Joint":
        """Returns the same joint with parent and child exchanged."""
        return replace(
            self,
            parent=self.child,
            child=self.parent,
            pose=self.offset.inverse(),
            offset=self.pose.inverse(),
            axis=(-self.axis[0], -self.axis[1], -self.axis[2]),
        )


def tree_of(links: Mapping[str, Pose], joints: Iterable[Joint]) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Returns joints that make one tree of all links, turned away from its root, and the names of those left over.

    The root is the world where a joint names it, else the first link. A joint that would close a ring is left over;
    links that no joint connects to the root are held to it by a fixed joint without a name.

    Args:
        links: each link's pose in the model.
        joints: between these links and `WORLD`.
    """
    pending = list(joints)
    root = WORLD if any(WORLD in (joint.parent, joint.child) for joint in pending) else next(iter(links))
    poses = {WORLD: IDENTITY, **links}
    reached, tree, closing = [root], [], []
    loose = [name for name in links if name != root]
    cursor = 0
    while True:
        while cursor < len(reached):
            for joint in [one for one in pending if reached[cursor] in (one.parent, one.child)]:
                pending.remove(joint)
                away = joint if joint.parent == reached[cursor] else joint.reversed()
                if away.child in reached:
                    closing.append(joint.name)
                else:
                    tree.append(away)
                    reached.append(away.child)
            cursor += 1
        loose = [name for name in loose if name not in reached]
        if not loose:
            return tuple(tree), tuple(closing)
        tree.append(Joint("", FIXED, root, loose[0], poses[root].inverse().compose(poses[loose[0]])))
        reached.append(loose[0])
