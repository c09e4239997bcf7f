"""Reads XML descriptions with checks: every error names the file, line and element, and the problem."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self

from lxml import etree

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.pose import IDENTITY, Pose, Vector

TRUE, FALSE = ("true", "1"), ("false", "0")


@dataclass(slots=True)
class _Kind:
    """Where a kind of element was found first, and how often in all."""

    first: str
    count: int = 0


class Notes:
    """Collects notes about what a reader ignores: each line once, in order of first appearance."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}
        self._kinds: dict[str, _Kind] = {}

    def add(self, line: str) -> None:
        """Adds ``line`` unless already present."""
        self._lines.setdefault(line)

    def count(self, element: "Element", message: str) -> None:
        """Adds a note about a kind of element: one line with the place of the first one, and how many there are."""
        kind = self._kinds.setdefault(message, _Kind(f"{element.source}, line {element.line}"))
        kind.count += 1

    def lines(self) -> tuple[str, ...]:
        """Returns all lines, those about kinds of elements last."""
        kinds = []
        for message, kind in self._kinds.items():
            often = f" ({kind.count} times)" if kind.count > 1 else ""
            kinds.append(f"{kind.first}: {message}{often}")
        return (*self._lines, *kinds)

    @contextmanager
    def leaving_out(self) -> Iterator[None]:
        """Turns a DescriptionError raised in the block into a note that what it is about is left out."""
        try:
            yield
        except DescriptionError as error:
            self.add(f"{error}; it is left out")


def _repaired(data: bytes) -> bytes:
    """Returns the document with every bare ``&`` escaped, and without an XML declaration that is not at its start."""
    start = data[:5]
    if start != b"<?xml":
        data = re.sub(rb"<\?xml\s[^>]*\?>", b"", data, count=1)
    return re.sub(rb"&(?!#?\w+;)", b"&amp;", data)


class Element:
    """An XML element that knows its source file."""

    def __init__(self, node: etree._Element, source: str) -> None:
        self._node = node
        self.source = source  #: name of the file in error messages
        self.tag = str(node.tag)  #: tag name

    @classmethod
    def from_text(cls, text: str | bytes, source: str, notes: Notes | None = None) -> Self:
        """Returns the root element of a document. External entities are not resolved.

        As in Gazebo, whitespace or a comment before the XML declaration and a bare ``&`` are accepted, with a note.

        Raises:
            DescriptionError: the text is not well-formed XML.
        """
        parser = etree.XMLParser(
            remove_comments=True, remove_pis=True, resolve_entities=False, no_network=True
        )
        data = text.encode() if isinstance(text, str) else text
        try:
            return cls(etree.fromstring(data, parser), source)
        except etree.XMLSyntaxError as error:
            repaired = _repaired(data)
            if repaired == data or notes is None:
                raise DescriptionError(f"{source}: not well-formed XML: {error.msg}") from None
            notes.add(f"{source}: not well-formed XML: {error.msg}; read as if that were correct")
            return cls.from_text(repaired, source)

    def note(self, notes: Notes, message: str) -> None:
        """Adds a note about this element, with file and line."""
        notes.add(str(self.error(message)))

    def error(self, message: str) -> DescriptionError:
        """Returns an error, to be raised, that names this element and its named ancestors."""
        path = [self._label(self._node)]
        parent = self._node.getparent()
        while parent is not None:
            if parent.get("name"):
                path.append(self._label(parent))
            parent = parent.getparent()
        return DescriptionError(
            f"{self.source}, line {self._node.sourceline}: {' '.join(reversed(path))}: {message}"
        )

    @property
    def line(self) -> int:
        """The line in its source."""
        return int(self._node.sourceline or 0)

    @staticmethod
    def _label(node: etree._Element) -> str:
        name = node.get("name")
        return f'<{node.tag} name="{name}">' if name else f"<{node.tag}>"

    @property
    def text(self) -> str:
        """The text content, stripped of surrounding whitespace."""
        return (self._node.text or "").strip()

    def version(self) -> str:
        """Returns the ``version`` attribute of the document's root; empty if absent."""
        return str(self._node.getroottree().getroot().get("version", ""))

    def children(self, *tags: str) -> Iterator["Element"]:
        """Yields the child elements with one of ``tags`` in document order; all children if no tag is given."""
        for node in self._node.iterchildren(tag=etree.Element):
            if not tags or node.tag in tags:
                yield Element(node, self.source)

    def child(self, path: str) -> "Element | None":
        """Returns the first child with this tag, or the descendant at a path such as ``clip/near``; None if absent."""
        found: Element | None = self
        for tag in path.split("/"):
            found = None if found is None else next(found.children(tag), None)
        return found

    def needed(self, tag: str) -> "Element":
        """Returns the first child with this tag, or the descendant at a path, as `child`.

        Raises:
            DescriptionError: there is no such child.
        """
        found = self.child(tag)
        if found is None:
            raise self.error(f"<{tag}> is missing")
        return found

    def attribute(self, name: str, default: str | None = None) -> str:
        """Returns an attribute, or ``default``.

        Raises:
            DescriptionError: it is absent or empty, and there is no default.
        """
        value = self._node.get(name)
        if value is None or not value.strip():
            if default is None:
                raise self.error(f'attribute "{name}" is missing')
            return default
        return str(value).strip()

    def numbers(self, count: int, text: str | None = None, what: str = "") -> tuple[float, ...]:
        """Returns ``count`` finite numbers from ``text``, by default from the text content.

        Raises:
            DescriptionError: the count differs, or a word is not a finite number.
        """
        words = (self.text if text is None else text).split()
        what = f"{what} " if what else ""
        if len(words) != count:
            raise self.error(
                f"{what}needs {count} number{'s' * (count != 1)}, not {len(words)}: {' '.join(words)!r}"
            )
        return tuple(self._number(word, what) for word in words)

    def _number(self, word: str, what: str) -> float:
        try:
            value = float(word)
        except ValueError:
            raise self.error(f"{what}{word!r} is not a number") from None
        if not math.isfinite(value):
            raise self.error(f"{what}{word!r} is not a finite number")
        return value

    def number(self, tag: str, default: float | None = None) -> float:
        """Returns the number in child ``tag`` (or path), or ``default`` if there is no such child.

        Raises:
            DescriptionError: the number is not finite, or there is neither a child nor a default.
        """
        found = self.child(tag) if default is not None else self.needed(tag)
        if found is None:
            assert default is not None
            return default
        return found.numbers(1)[0]

    def positive(self, tag: str, default: float | None = None) -> float:
        """Returns the number in child ``tag`` (or path); raises DescriptionError unless it is positive."""
        value = self.number(tag, default)
        if value <= 0:
            raise self.needed(tag).error(f"must be above 0, not {value:g}")
        return value

    def integer(self, tag: str) -> int:
        """Returns the integer in child ``tag``."""
        value = self.number(tag)
        if value != int(value):
            raise self.needed(tag).error(f"must be a whole number, not {value:g}")
        return int(value)

    def vector(self, text: str | None = None, what: str = "") -> Vector:
        """Returns three numbers from ``text``, by default from the text content."""
        x, y, z = self.numbers(3, text, what)
        return x, y, z

    def direction(self, text: str | None = None, what: str = "") -> Vector:
        """Returns three numbers normalised to a unit vector."""
        x, y, z = self.vector(text, what)
        length = math.hypot(x, y, z)
        if length < 1e-9:
            raise self.error("must not be 0 0 0")
        return x / length, y / length, z / length

    def pose(self) -> Pose:
        """Returns the pose in the text content, x y z roll pitch yaw [m, rad]."""
        return Pose.from_rpy(*self.numbers(6))

    def placed(self) -> Pose:
        """Returns the pose in child ``<pose>``; the identity if absent or empty."""
        pose = self.child("pose")
        return IDENTITY if pose is None or not pose.text else pose.pose()

    def flag(self, tag: str, default: bool = False) -> bool:
        """Returns the boolean in child ``tag`` (true, 1, false, 0), or ``default``."""
        found = self.child(tag)
        return default if found is None else found.truth()

    def truth(self, text: str | None = None) -> bool:
        """Returns ``text``, by default the text content, as a boolean: true, 1, false or 0."""
        word = (self.text if text is None else text).lower()
        if word not in TRUE + FALSE:
            raise self.error(f"must be true or false, not {word!r}")
        return word in TRUE

    def word(self, tag: str, default: str) -> str:
        """Returns the text in child ``tag`` (or path), or ``default`` if absent or empty."""
        found = self.child(tag)
        return (found.text if found is not None else "") or default


def library_of(plugin: Element) -> str:
    """Returns the name of a plugin's library without folder, ``lib`` and ``.so``."""
    file = plugin.attribute("filename", "").rpartition("/")[2]
    return file.removeprefix("lib").removesuffix(".so")
