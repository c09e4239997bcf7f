"""Reads the settings of sensors and plugins, from SDF and URDF alike, and checks the names they refer to."""

import difflib
import typing
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, TypeVar

from pioneer_gazebo.adapters.element import Element, Notes

Config = TypeVar("Config")

QUIET = {"alwaysOn", "always_on", "rosDebugLevel", "robotNamespace", "robotParam", "robotSimType"}
"""Plugin elements that are read elsewhere or have no effect here."""

ALIASES = {"torque": "wheelTorque", "jointNames": "jointName"}
"""Spellings used by other releases of the plugins."""


@dataclass(frozen=True, slots=True)
class Names:
    """The link and joint names that a robot's plugins and sensors may refer to."""

    links: Collection[str]
    joints: Collection[str]

    def check_link(self, element: Element, name: str) -> None:
        """Raises DescriptionError if the robot has no such link."""
        _check(element, "link", name, self.links)

    def check_joint(self, element: Element, name: str) -> None:
        """Raises DescriptionError if the robot has no such joint."""
        _check(element, "joint", name, self.joints)


def note_unread(plugin: Element, read: Collection[str], notes: Notes) -> None:
    """Adds a note for every element of a plugin that is not in ``read``."""
    for child in plugin.children():
        if child.tag not in QUIET and child.tag not in read:
            notes.add(f"<{child.tag}> of plugin lib{library_of(plugin)}.so is not supported and ignored")


def _check(element: Element, what: str, name: str, names: Collection[str]) -> None:
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        raise element.error(f"unknown {what} {name!r}" + (f"; did you mean {near[0]!r}?" if near else ""))


def library_of(plugin: Element) -> str:
    """Returns the library's name without folder, ``lib`` and ``.so``."""
    return plugin.attribute("filename").rpartition("/")[2].removeprefix("lib").removesuffix(".so")


def filled(config: type[Config], element: Element, notes: Notes, known: Collection[str] = (), **given: Any) -> Config:
    """Returns a ``config`` whose fields are filled from the child elements of the same name and from ``given``.

    Args:
        config: the class.
        element: the plugin.
        notes: receives a note for each child that is neither a field nor in ``known``.
        known: tags that the caller reads, or that have no effect.
        **given: further fields.

    Raises:
        DescriptionError: a value is invalid.
    """
    hints = typing.get_type_hints(config)
    for child in element.children():
        tag = ALIASES.get(child.tag, child.tag)
        if tag in hints:
            given[tag] = _READERS[hints[tag]](child)
        elif tag not in QUIET and tag not in known:
            near = difflib.get_close_matches(tag, hints, n=1)
            hint = f"; did you mean <{near[0]}>?" if near else ""
            notes.add(f"<{tag}> of plugin lib{library_of(element)}.so is not supported and ignored{hint}")
    return config(**given)


def _read_names(element: Element) -> tuple[str, ...]:
    return tuple(element.text.replace(",", " ").split())


_READERS: dict[Any, Callable[[Element], Any]] = {
    str: lambda element: element.text,
    float: lambda element: element.numbers(1)[0],
    int: lambda element: int(element.numbers(1)[0]),
    bool: Element.truth,
    tuple[str, ...]: _read_names,
    tuple[float, float, float]: Element.vector,
}
