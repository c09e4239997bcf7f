"""Messages as bytes: from the encoding of ROS 1 to that of ROS 2 and back, without Python objects on the way.

rosbags generates the code for each type from its definition. Of the standard types all but a few have the same fields
in both; for those few, the fields that exist on both sides are copied and the others keep their defaults.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from pioneer_ros2.error import TypeUnknownError
from pioneer_ros2.naming import ros2_type

_HEADER = "std_msgs/msg/Header"
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
"""Kinds of fields in rosbags' definitions."""

Bytes = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Converter:
    """How messages of one type are converted."""

    type_name: str  #: package/Name
    type_hash: str  #: RIHS01 hash of the type in ROS 2
    to_cdr: Bytes  #: from ROS 1's encoding to ROS 2's, with its header of four bytes
    to_ros1: Bytes  #: the other way
    only_ros1: tuple[str, ...] = field(
        default=()
    )  #: fields that ROS 2 does not have, other than ``Header.seq``
    only_ros2: tuple[str, ...] = field(default=())  #: fields that ROS 1 does not have


class MessageTypes:
    """Definitions of message types on both sides: the standard ones, and what is registered from definitions."""

    def __init__(self, release: Stores = Stores.ROS2_KILTED) -> None:
        self._ros1 = get_typestore(Stores.ROS1_NOETIC)
        self._ros2 = get_typestore(release)
        self._converters: dict[str, Converter] = {}

    def fields(self, type_name: str) -> list[tuple[str, Any]]:
        """Returns the fields of a type in ROS 2, as rosbags describes them. ``type_name`` is ``package/msg/Name``."""
        return self._ros2.fielddefs[type_name][1]

    def type_hash(self, type_name: str) -> str:
        """Returns the RIHS01 hash of the type ``package/Name`` in ROS 2."""
        return self._ros2.hash_rihs01(ros2_type(type_name))

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
        type_hash = self.type_hash(type_name)
        if _layout(self._ros1, name) == _layout(self._ros2, name):
            return Converter(
                type_name,
                type_hash,
                lambda message: bytes(self._ros2.ros1_to_cdr(message, name)),
                lambda message: bytes(self._ros2.cdr_to_ros1(message, name)),
            )
        old = set(_paths(self._ros1, name))
        new = set(_paths(self._ros2, name))
        return Converter(
            type_name,
            type_hash,
            lambda message: self._object_to_cdr(message, name),
            lambda message: self._object_to_ros1(message, name),
            tuple(sorted(old - new)),
            tuple(sorted(new - old)),
        )

    def _register(self, name: str, type_name: str, definition: str) -> None:
        """Makes the type known to both stores."""
        if name in self._ros1.fielddefs and name in self._ros2.fielddefs:
            return
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

    def _object_to_cdr(self, message: bytes, name: str) -> bytes:
        value = self._ros1.deserialize_ros1(message, name)
        return bytes(self._ros2.serialize_cdr(_as_type(self._ros2, name, value), name))

    def _object_to_ros1(self, message: bytes, name: str) -> bytes:
        value = self._ros2.deserialize_cdr(message, name)
        return bytes(self._ros1.serialize_ros1(_as_type(self._ros1, name, value), name))


def _parts(store: Any, name: str) -> list[str]:
    """Returns the type and all types that it is made of, however deep, parts first."""
    found: list[str] = []
    for _, (kind, argument) in store.fielddefs[name][1]:
        inner_kind, inner = argument[0] if kind in (_ARRAY, _SEQUENCE) else (kind, argument)
        if inner_kind == _NAME:
            found += [part for part in _parts(store, inner) if part not in found]
    return [*found, name]


def _layout(store: Any, name: str) -> tuple[Any, ...]:
    """Returns the kinds of a type's fields in order, those of its parts included; ``Header.seq`` is left out."""
    found = []
    for field_name, definition in store.fielddefs[name][1]:
        if name != _HEADER or field_name != "seq":
            found.append(_field_layout(store, definition))
    return tuple(found)


def _field_layout(store: Any, definition: Any) -> Any:
    kind, argument = definition
    if kind == _NAME:
        return _layout(store, argument)
    if kind in (_ARRAY, _SEQUENCE):
        # The bound of a sequence is not part of its encoding, the length of an array is.
        return int(kind), _field_layout(store, argument[0]), argument[1] if kind == _ARRAY else None
    return argument[0]


def _paths(store: Any, name: str, above: str = "") -> list[str]:
    """Returns the names of a type's plain fields, with dots for those of its parts."""
    found = []
    for field_name, (kind, argument) in store.fielddefs[name][1]:
        inner_kind, inner = argument[0] if kind in (_ARRAY, _SEQUENCE) else (kind, argument)
        if name == _HEADER and field_name == "seq":
            continue
        if inner_kind == _NAME:
            found += _paths(store, inner, f"{above}{field_name}.")
        else:
            found.append(f"{above}{field_name}")
    return found


def _as_type(store: Any, name: str, value: Any) -> Any:
    """Returns ``value`` as the type ``name`` of ``store``: fields of the same name are copied, others get defaults."""
    values = {}
    for field_name, definition in store.fielddefs[name][1]:
        if hasattr(value, field_name):
            values[field_name] = _converted(store, definition, getattr(value, field_name))
        else:
            values[field_name] = _default(store, definition)
    return store.types[name](**values)


def _converted(store: Any, definition: Any, value: Any) -> Any:
    kind, argument = definition
    if kind == _NAME:
        return _as_type(store, argument, value)
    if kind in (_ARRAY, _SEQUENCE) and argument[0][0] == _NAME:
        return [_as_type(store, argument[0][1], each) for each in value]
    return value


def _default(store: Any, definition: Any) -> Any:
    kind, argument = definition
    if kind == _NAME:
        return _as_type(store, argument, None)
    if kind == _SEQUENCE:
        return _empty(argument[0])
    if kind == _ARRAY:
        inner, length = argument
        if inner[0] == _BASE and inner[1][0] not in ("string", "wstring"):
            return _zeros(inner[1][0], length)
        return [_default(store, inner) for _ in range(length)]
    return _BASE_DEFAULTS.get(argument[0], 0)


_BASE_DEFAULTS = {"string": "", "wstring": "", "bool": False, "float32": 0.0, "float64": 0.0}


def _empty(inner: Any) -> Any:
    kind, argument = inner
    if kind == _BASE and argument[0] not in ("string", "wstring"):
        return _zeros(argument[0], 0)
    return []


def _zeros(base: str, length: int) -> Any:
    import numpy as np

    return np.zeros(length, {"byte": "uint8", "char": "uint8", "octet": "uint8"}.get(base, base))
