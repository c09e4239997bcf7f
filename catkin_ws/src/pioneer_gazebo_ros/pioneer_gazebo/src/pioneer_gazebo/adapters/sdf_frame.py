"""Resolves SDF poses relative to other elements (``relative_to`` in 1.7, ``frame`` in 1.5 and 1.6)."""

from pioneer_gazebo.adapters.element import Element
from pioneer_gazebo.core.pose import Pose

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
