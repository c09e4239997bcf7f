"""Joints, and the kinematic tree of links and joints."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector

FIXED, CONTINUOUS, REVOLUTE, PRISMATIC, FLOATING = (
    "fixed",
    "continuous",
    "revolute",
    "prismatic",
    "floating",
)

WORLD = "world"
"""The link by which SDF joints attach a model to the world."""


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint between two links."""

    name: str  #: unique in the robot or model
    kind: str  #: fixed, continuous, revolute, prismatic or floating
    parent: str  #: name of the link towards the root
    child: str  #: name of the link that this joint moves
    pose: Pose = IDENTITY  #: joint frame in the parent's frame, at position 0
    axis: Vector = (1.0, 0.0, 0.0)  #: unit vector in the joint frame
    lower: float = float("-inf")  #: lower limit [rad or m]; -inf for none
    upper: float = float("inf")  #: upper limit [rad or m]; inf for none
    effort: float = float("inf")  #: maximum force or torque [N or N m]; inf for none
    velocity: float = float("inf")  #: maximum speed [rad/s or m/s]
    damping: float = 0.0  #: [N m s/rad or N s/m]
    friction: float = 0.0  #: static friction [N m or N]
    offset: Pose = IDENTITY  #: child frame in the joint frame; the identity in URDF

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


def tree_of(
    links: Mapping[str, Pose], joints: Iterable[Joint]
) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Returns joints that form a tree of all links, directed away from the root, and the names of those left over.

    The root is the world if a joint refers to it, otherwise the first link. A joint that would close a loop is left
    over; links without a connection to the root are attached to it by an unnamed fixed joint.

    Args:
        links: each link's pose in the model.
        joints: between these links and `WORLD`.
    """
    pending = list(joints)
    root = (
        WORLD
        if any(WORLD in (joint.parent, joint.child) for joint in pending)
        else next(iter(links))
    )
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
        tree.append(
            Joint("", FIXED, root, loose[0], poses[root].inverse().compose(poses[loose[0]]))
        )
        reached.append(loose[0])
