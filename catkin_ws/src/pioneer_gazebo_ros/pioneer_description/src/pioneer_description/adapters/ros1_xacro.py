"""Runs xacro 2, written for ROS 2, on ROS 1 files: ``$(find)`` through rospkg, and tags without ``xacro:``.

Files written for Hydro and Indigo omit the ``xacro:`` prefix (``<macro>``, ``<property>``, a macro's bare name).
xacro dropped that in Noetic; here it still works, with one warning per file.
"""

import sys
from xml.dom.minidom import Document, Element

import rospkg
import xacro
import xacro.substitution_args

_TAGS = {
    "arg": ("name", "default"),
    "if": ("value",),
    "include": ("filename",),
    "insert_block": ("name",),
    "macro": ("name",),
    "property": ("name",),
    "unless": ("value",),
}
"""Tags that Indigo's xacro accepted without prefix, and the attributes that tell them from a plugin's own elements."""
_OWN_ELEMENTS = {
    "link", "joint", "inertial", "inertia", "visual", "collision", "geometry", "material", "texture", "transmission",
    "actuator", "gazebo", "sensor", "plugin", "origin", "parent", "child", "axis", "limit", "dynamics", "mimic",
    "safety_controller", "mass", "box", "cylinder", "sphere", "mesh", "color", "robot",
}  # fmt: skip
"""URDF elements, which are never treated as calls of a macro of the same name."""
_DROPPED = frozenset({"--legacy", "--xacro-ns", "--check-order"})
"""Options of older releases: their effect is now the default, or they set an evaluation order nothing relies on."""

_parse, _handle_macro_call = xacro.parse, xacro.handle_macro_call
_warned: set[str] = set()


def package_path(name: str) -> str:
    """Returns the folder of a ROS package.

    Raises:
        SubstitutionException: there is no such package.
    """
    try:
        return rospkg.RosPack().get_path(name)
    except rospkg.ResourceNotFound:
        text = f"package '{name}' not found; is its workspace sourced?"
        raise xacro.substitution_args.SubstitutionException(text) from None


def parse_with_bare_tags(source: object, filename: str | None = None) -> Document:
    """Parses as xacro does, then adds the prefix to Indigo's bare tags."""
    document: Document = _parse(source, filename)
    for name, attributes in _TAGS.items():
        for element in list(document.getElementsByTagName(name)):
            if all(element.hasAttribute(one) for one in attributes):
                _add_prefix(element)
    return document


def expand_bare_call(element: Element, macros: object, symbols: object) -> bool:
    """Expands a macro call as xacro does, with or without the prefix; returns whether it was a call."""
    name = element.tagName
    if ":" not in name and name not in _OWN_ELEMENTS and _is_macro(name, macros, symbols):
        _add_prefix(element)
    return bool(_handle_macro_call(element, macros, symbols))


def _is_macro(name: str, macros: object, symbols: object) -> bool:
    try:
        xacro.resolve_macro(name, macros, symbols)
    except KeyError:
        return False
    return True


def _add_prefix(element: Element) -> None:
    file = str(xacro.filestack[-1] or "string") if xacro.filestack else "string"
    if file not in _warned:
        _warned.add(file)
        xacro.warning(
            f"{file}: <{element.tagName}> has no 'xacro:' prefix; newer xacro releases ignore such tags"
        )
    element.tagName = element.nodeName = f"xacro:{element.tagName}"


def main() -> None:
    """Runs xacro's command line on ROS 1."""
    sys.argv[1:] = [word for word in sys.argv[1:] if word not in _DROPPED]
    xacro.substitution_args._eval_find = package_path
    xacro.substitution_args._eval_dict["find"] = package_path
    xacro.parse, xacro.handle_macro_call = parse_with_bare_tags, expand_bare_call
    xacro.main()
