"""Message types on both sides: their definitions, by rosbags, and the conversion of each from bytes to bytes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from pioneer_ros2 import transcoder
from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.naming import ros2_type
from pioneer_ros2.transcoder import Bytes, Definitions, OrderError

RELEASES = {
    "humble": Stores.ROS2_HUMBLE,
    "iron": Stores.ROS2_IRON,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
}
"""Releases of ROS 2 whose published definitions are known."""

_HEADER = "std_msgs/msg/Header"
_NAME, _ARRAY, _SEQUENCE = 2, 3, 4
"""Kinds of fields in rosbags' definitions."""


@dataclass(frozen=True)
class Converter:
    """How messages of one type are converted. Both functions raise MalformedError or struct.error."""

    type_name: str  #: package/Name
    type_hash: str  #: RIHS01 hash of the type in ROS 2
    to_cdr: Bytes  #: from ROS 1's encoding to ROS 2's, with its header of four bytes
    to_ros1: Bytes  #: the other way
    only_ros1: tuple[str, ...] = ()  #: fields that ROS 2 does not have, other than ``Header.seq``
    only_ros2: tuple[str, ...] = ()  #: fields that ROS 1 does not have


class Ros1Kind:
    """Stands for a message class of ROS 1 where only its identity is needed: messages stay bytes."""

    def __init__(self, type_name: str, md5sum: str = "*", definition: str = "") -> None:
        self._type = type_name
        self._md5sum = md5sum
        self._full_text = definition


class MessageTypes:
    """Definitions of message types on both sides: the standard ones, and what is registered from definitions.

    Args:
        release: the release of ROS 2, one of `RELEASES`.
        installed: returns the definition of a type, ``package/Name``, that is installed here; else an empty text.
    """

    def __init__(
        self, release: str = "kilted", installed: Callable[[str], str] = lambda _: ""
    ) -> None:
        self._installed = installed
        self._ros1 = get_typestore(Stores.ROS1_NOETIC)
        self._ros2 = get_typestore(RELEASES[release])
        self._converters: dict[str, Converter] = {}

    def fields(self, type_name: str) -> list[tuple[str, Any]]:
        """Returns the fields of a type in ROS 2, as rosbags describes them. ``type_name`` is ``package/msg/Name``."""
        return self._ros2.fielddefs[type_name][1]

    def type_hash(self, type_name: str) -> str:
        """Returns the RIHS01 hash of the type ``package/Name`` in ROS 2."""
        return self._ros2.hash_rihs01(ros2_type(type_name))

    def ros1_kind(self, type_name: str, definition: str = "") -> "Ros1Kind":
        """Returns what identifies the type ``package/Name`` in ROS 1. Arguments and errors as for `converter`."""
        self.converter(type_name, definition)
        text, md5sum = self._ros1.generate_msgdef(ros2_type(type_name), ros_version=1)
        return Ros1Kind(type_name, md5sum, text)

    def leading_frames(self, type_name: str) -> int:
        """Returns how many frames messages of the type ``package/Name`` begin with in ROS 1: 0 without a Header.

        2 if a field ``child_frame_id`` follows the Header. The type must be known, see `converter`.
        """
        fields = self._ros1.fielddefs[ros2_type(type_name)][1]
        if not fields or fields[0][1] != (_NAME, _HEADER):
            return 0
        has_child = len(fields) > 1 and fields[1][0] == "child_frame_id"
        return 2 if has_child else 1

    def converter(self, type_name: str, definition: str = "") -> Converter:
        """Returns the converter of messages of type ``package/Name``.

        Args:
            type_name: the type's name in ROS 1.
            definition: its definition with those of its parts, as TCPROS carries it; for types that ROS 2 lacks.

        Raises:
            TypeUnknownError: there is no definition, or it cannot be read.
        """
        if type_name not in self._converters:
            self._converters[type_name] = self._new_converter(type_name, definition)
        return self._converters[type_name]

    def _new_converter(self, type_name: str, definition: str) -> Converter:
        name = ros2_type(type_name)
        self._register(name, type_name, definition)
        old = self._ros1.fielddefs
        new = self._ros2.fielddefs
        try:
            to_cdr = transcoder.to_cdr(old, new, name)
            to_ros1 = transcoder.to_ros1(old, new, name)
        except OrderError as error:
            raise TypeUnknownError(str(error)) from None
        paths1 = set(_paths(old, name, is_cdr=False))
        paths2 = set(_paths(new, name, is_cdr=True))
        return Converter(
            type_name,
            self.type_hash(type_name),
            to_cdr,
            to_ros1,
            only_ros1=tuple(sorted(paths1 - paths2)),
            only_ros2=tuple(sorted(paths2 - paths1)),
        )

    def _register(self, name: str, type_name: str, definition: str) -> None:
        """Makes the type known to both stores."""
        if name in self._ros1.fielddefs and name in self._ros2.fielddefs:
            return
        if name not in self._ros1.fielddefs:
            definition = definition or self._installed(type_name)
        if not definition and name not in self._ros1.fielddefs:
            raise TypeUnknownError(
                f"there is no definition of {type_name} yet: no ROS 1 node has sent one"
            )
        try:
            if name not in self._ros1.fielddefs:
                types = get_types_from_msg(definition, name)
                self._ros1.register(
                    {each: types[each] for each in types if each not in self._ros1.fielddefs}
                )
            needed = {each: self._ros1.fielddefs[each] for each in _parts(self._ros1, name)}
            self._ros2.register(
                {each: needed[each] for each in needed if each not in self._ros2.fielddefs}
            )
        except (TypesysError, KeyError, ValueError) as error:
            raise TypeUnknownError(
                f"the definition of {type_name} cannot be read: {error}"
            ) from None


def _parts(store: Any, name: str) -> list[str]:
    """Returns the type and all types that it is made of, however deep, parts first."""
    found: list[str] = []
    for _, (kind, argument) in store.fielddefs[name][1]:
        inner_kind, inner = argument[0] if kind in (_ARRAY, _SEQUENCE) else (kind, argument)
        if inner_kind == _NAME:
            found += [part for part in _parts(store, inner) if part not in found]
    return [*found, name]


def _paths(definitions: Definitions, name: str, is_cdr: bool, above: str = "") -> list[str]:
    """Returns the names of a type's plain fields in lower case, with dots for those of its parts."""
    found = []
    for field_name, (kind, argument) in transcoder.fields_of(definitions, name, is_cdr):
        inner_kind, inner = argument[0] if kind in (_ARRAY, _SEQUENCE) else (kind, argument)
        if name == _HEADER and field_name == "seq":
            continue
        path = f"{above}{field_name.lower()}"
        if inner_kind == _NAME:
            found += _paths(definitions, inner, is_cdr, f"{path}.")
        else:
            found.append(path)
    return found
