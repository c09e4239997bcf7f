r"""Code that converts messages between the encodings of ROS 1 and ROS 2, generated for each type from its definitions.

Both encodings have the same fields in the same order, little-endian. They differ in three things: CDR (ROS 2) aligns
each field to its size and ends strings with a NUL; ``Header.seq`` exists in ROS 1 only; some types have additional
fields in ROS 2. Neighbouring fields of fixed size are therefore copied as one slice, and no field becomes an object.
For ``std_msgs/Header`` the function from ROS 1 to ROS 2 is, without its checks:

.. code-block:: python

    i = 4                                        # Header.seq
    out += (d[i:i + 8],)                         # stamp
    i += 8
    n, = unpack(d, i)                            # frame_id
    out += (pack(n + 1), d[i + 4:i + 4 + n], b"\0")

A field that exists on one side only is skipped, or gets its default.
"""

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pioneer_ros2.error import DoorError

Bytes = Callable[[bytes | memoryview], bytes]
Definitions = Mapping[str, Any]
"""Type definitions as rosbags has them: by ``package/msg/Name`` the constants and the fields, ``(name, kind)`` each."""

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
"""Kinds of fields in rosbags' definitions."""
_SIZES = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip
_WIDEST = 8
_LENGTH = 4
"""Size of the length of a string or sequence [bytes]."""
_CDR_HEADER = b"\0\1\0\0"
"""CDR, little-endian, no options."""
_END_PADDING = 3
"""Padding that some writers add at the end of a CDR message [bytes]."""
_FILLER = "structure_needs_at_least_one_member"
"""A field of ROS 2 in types without fields; rosbags lists it for ROS 1 too, where it does not exist."""
_UNROLLED = 4
"""Arrays of at most this many structures become straight code instead of a loop."""


class MalformedError(DoorError):
    """A message that does not follow its type's definition."""


class OrderError(DoorError):
    """A type whose common fields have another order in ROS 2."""


def fields_of(definitions: Definitions, name: str, is_cdr: bool) -> list[tuple[str, Any]]:
    """Returns the fields of a type that are really encoded."""
    fields = definitions[name][1]
    return [field for field in fields if is_cdr or field[0] != _FILLER]


def to_cdr(ros1: Definitions, ros2: Definitions, name: str) -> Bytes:
    """Returns the function that converts messages of a type, ``package/msg/Name``, from ROS 1 to ROS 2.

    The function raises MalformedError or struct.error.

    Raises:
        OrderError: the sides have their common fields in another order.
    """
    return _Generator(_Side("i", ros1, False), _Side("o", ros2, True)).function(name)


def to_ros1(ros1: Definitions, ros2: Definitions, name: str) -> Bytes:
    """Returns the function for the other way. See `to_cdr`."""
    return _Generator(_Side("i", ros2, True), _Side("o", ros1, False)).function(name)


class _Side:
    """Source or target in the generated code: its position, as far as it is known when the code is generated."""

    def __init__(self, variable: str, definitions: Definitions, is_cdr: bool) -> None:
        self.variable = variable
        self.definitions = definitions
        self.is_cdr = is_cdr
        self._modulus = _WIDEST
        self._rest = 0  # the position modulo _modulus

    def fields(self, name: str) -> list[tuple[str, Any]]:
        return fields_of(self.definitions, name, self.is_cdr)

    def padding(self, alignment: int) -> int | None:
        """Returns the padding before a field; None if only the running code can tell."""
        if not self.is_cdr:
            return 0
        if self._modulus >= alignment:
            return -self._rest % alignment
        return None

    def align(self, alignment: int) -> None:
        """Takes up that the position is aligned now."""
        if self._modulus >= alignment:
            self._rest += -self._rest % alignment
            self._rest %= self._modulus
        else:
            self._modulus = alignment
            self._rest = 0

    def advance(self, size: int) -> None:
        self._rest = (self._rest + size) % self._modulus

    def forget(self, modulus: int = 1) -> None:
        """Takes up that the position is only known to be a multiple of ``modulus``."""
        self._modulus = modulus
        self._rest = 0


class _Generator:
    """Generates the code for one type and direction.

    The code has these variables: ``d`` data, ``i`` position in it, ``size`` its length, ``out`` the parts of the
    result, ``o`` their length (only if the target aligns), ``n`` a length that was read.
    """

    def __init__(self, source: _Side, target: _Side) -> None:
        self._source = source
        self._target = target
        self._lines: list[str] = []
        self._depth = 1
        self._run = 0  # bytes from i on that are to be copied, and for which there is no code yet
        self._keeps = True

    def function(self, name: str) -> Bytes:
        self._emit("d = memoryview(data)")
        if self._source.is_cdr:
            self._emit("d = without_header(d)")
        self._emit("size = len(d)")
        self._emit("i = 0")
        if self._target.is_cdr:
            self._emit("o = 0")
            self._emit("out = [CDR_HEADER]")
        else:
            self._emit("out = []")
        self._structure(name, name)
        self._copy_run()
        slack = _END_PADDING if self._source.is_cdr else 0
        self._emit(f"if not size - {slack} <= i <= size: raise ends_early(i, size)")
        self._emit("return join(out)")
        names = {
            "unpack": struct.Struct("<I").unpack_from,
            "pack": struct.Struct("<I").pack,
            "ZEROS": [bytes(count) for count in range(_WIDEST)],
            "CDR_HEADER": _CDR_HEADER,
            "without_header": _without_header,
            "ends_early": _ends_early,
            "too_many": _too_many,
            "join": b"".join,
        }
        code = "\n".join(["def convert(data):", *self._lines])
        exec(compile(code, f"<conversion of {name}>", "exec"), names)
        return names["convert"]  # type: ignore[return-value]

    def _emit(self, line: str) -> None:
        self._lines.append(f"{'    ' * self._depth}{line}")

    # Structures

    def _structure(self, old: str, new: str) -> None:
        """Converts a structure, which may have another definition in the target."""
        for source_kind, target_kind in self._pairs(old, new):
            if target_kind is None:
                kept = self._keeps
                self._copy_run()
                self._keeps = False
                self._field(source_kind, source_kind)
                self._copy_run()
                self._keeps = kept
            elif source_kind is None:
                self._copy_run()
                self._default(target_kind)
            else:
                self._field(source_kind, target_kind)

    def _pairs(self, old: str, new: str) -> Iterator[tuple[Any, Any]]:
        """Yields the kinds of fields that belong together, in order; None for a side that lacks the field."""
        source = self._source.fields(old)
        target = self._target.fields(new) if self._keeps else source
        if len(source) == len(target):
            for (_, source_kind), (_, target_kind) in zip(source, target, strict=True):
                yield source_kind, target_kind
            return
        # ROS 2 writes all names of fields in lower case.
        names = [name.lower() for name, _ in source]
        position = 0
        for name, target_kind in target:
            if name.lower() not in names:
                yield None, target_kind
                continue
            end = names.index(name.lower())
            if end < position:
                raise OrderError(f"the fields of {new} have another order in ROS 2")
            for _, source_kind in source[position:end]:
                yield source_kind, None
            yield source[end][1], target_kind
            position = end + 1
        for _, source_kind in source[position:]:
            yield source_kind, None

    def _field(self, source_kind: Any, target_kind: Any) -> None:
        kind, argument = source_kind
        if kind == _BASE:
            if argument[0] == "string":
                self._string()
            else:
                self._fixed(_SIZES[argument[0]], _SIZES[argument[0]])
        elif kind == _NAME:
            self._structure(argument, target_kind[1])
        elif kind == _ARRAY:
            self._array(argument[0], target_kind[1][0], argument[1])
        else:
            self._sequence(argument[0], target_kind[1][0])

    # Fields

    def _fixed(self, size: int, alignment: int) -> None:
        """Converts a field of fixed size: part of a run as long as no side needs padding before it."""
        self._align(alignment)
        self._run += size
        self._source.advance(size)
        if self._keeps:
            self._target.advance(size)

    def _align(self, alignment: int) -> None:
        before = self._source.padding(alignment)
        after = self._target.padding(alignment) if self._keeps else 0
        if before != 0 or after != 0:
            self._copy_run()
        if before is None:
            self._emit(f"i += -i & {alignment - 1}")
        elif before:
            self._emit(f"i += {before}")
        if self._keeps:
            self._pad_target(alignment)
        self._source.align(alignment)

    def _pad_target(self, alignment: int) -> None:
        padding = self._target.padding(alignment)
        if padding is None:
            self._emit(f"p = -o & {alignment - 1}")
            self._emit("out.append(ZEROS[p])")
            self._emit("o += p")
        elif padding:
            self._emit(f"out.append(ZEROS[{padding}])")
            self._emit(f"o += {padding}")
        self._target.align(alignment)

    def _copy_run(self) -> None:
        if not self._run:
            return
        self._emit(f"e = i + {self._run}")
        if self._keeps:
            self._emit("out.append(d[i:e])")
            self._count(str(self._run))
        self._emit("i = e")
        self._run = 0

    def _count(self, size: str) -> None:
        """Counts what was added to the result, if anything will ask for it."""
        if self._target.is_cdr:
            self._emit(f"o += {size}")

    def _string(self) -> None:
        self._align(_LENGTH)
        self._copy_run()
        self._emit("n, = unpack(d, i)")
        if self._source.is_cdr:
            # The NUL counts; an empty string may come without it.
            self._emit("end = i + 4 + n")
            self._emit("n -= n > 0")
        else:
            self._emit("end = i + 4 + n")
        self._emit("if end > size: raise ends_early(end, size)")
        if self._keeps:
            self._put_string()
        self._emit("i = end")
        self._source.forget()
        if self._keeps:
            self._target.forget()

    def _put_string(self) -> None:
        if self._target.is_cdr:
            self._emit('out += (pack(n + 1), d[i + 4:i + 4 + n], b"\\0")')
            self._emit("o += n + 5")
        else:
            self._emit("out += (pack(n), d[i + 4:i + 4 + n])")

    def _array(self, source_kind: Any, target_kind: Any, length: int) -> None:
        block = self._block(source_kind, target_kind)
        if block is not None:
            size, alignment = block
            self._fixed(size * length, alignment)
        elif length <= _UNROLLED:
            for _ in range(length):
                self._field(source_kind, target_kind)
        else:
            self._copy_run()
            self._loop(str(length), source_kind, target_kind)

    def _sequence(self, source_kind: Any, target_kind: Any) -> None:
        self._fixed(_LENGTH, _LENGTH)
        self._copy_run()
        self._emit("n, = unpack(d, i - 4)")
        block = self._block(source_kind, target_kind)
        if block is None:
            self._emit(f"if n > (size - i) // {self._least(source_kind)}: raise too_many(n)")
            self._loop("n", source_kind, target_kind)
            return
        size, alignment = block
        self._emit("if n:")
        self._depth += 1
        self._align(alignment)
        self._emit(f"n *= {size}" if size > 1 else "pass")
        self._emit("e = i + n")
        self._emit("if e > size: raise ends_early(e, size)")
        if self._keeps:
            self._emit("out.append(d[i:e])")
            self._count("n")
        self._emit("i = e")
        self._depth -= 1
        known = _LENGTH if size % _LENGTH == 0 else 1
        self._source.forget(known)
        if self._keeps:
            self._target.forget(known)

    def _loop(self, count: str, source_kind: Any, target_kind: Any) -> None:
        self._forget_both()
        self._emit(f"for _ in range({count}):")
        self._depth += 1
        first = len(self._lines)
        self._field(source_kind, target_kind)
        self._copy_run()
        if len(self._lines) == first:
            self._emit("pass")
        self._depth -= 1
        self._forget_both()

    def _forget_both(self) -> None:
        self._source.forget()
        if self._keeps:
            self._target.forget()

    # Defaults

    def _default(self, kind: Any) -> None:
        """Writes a field that the source lacks."""
        name, argument = kind
        if name == _NAME:
            for _, inner in self._target.fields(argument):
                self._default(inner)
        elif name == _ARRAY:
            for _ in range(argument[1]):
                self._default(argument[0])
        elif name == _SEQUENCE:
            self._put_zeros(_LENGTH, _LENGTH)
        elif argument[0] != "string":
            self._put_zeros(_SIZES[argument[0]], _SIZES[argument[0]])
        elif self._target.is_cdr:
            self._pad_target(_LENGTH)
            self._emit('out.append(b"\\1\\0\\0\\0\\0")')
            self._emit("o += 5")
            self._target.advance(5)
        else:
            self._put_zeros(_LENGTH, _LENGTH)

    def _put_zeros(self, size: int, alignment: int) -> None:
        self._pad_target(alignment)
        self._emit(f"out.append({bytes(size)!r})")
        self._count(str(size))
        self._target.advance(size)

    # Sizes

    def _block(self, source_kind: Any, target_kind: Any) -> tuple[int, int] | None:
        """Returns size and alignment of an element that is the same bytes on both sides, without padding; else None."""
        bases = _bases(self._source, source_kind)
        if bases is None or bases != _bases(
            self._target if self._keeps else self._source, target_kind
        ):
            return None
        sizes = [_SIZES[base] for base in bases]
        alignment = max(sizes, default=1)
        position = 0
        for size in sizes:
            if position % size:
                return None
            position += size
        if not position or position % alignment:
            return None
        return position, alignment

    def _least(self, kind: Any) -> int:
        """Returns the least size of an element in the source, at least 1."""
        return max(1, _least_size(self._source, kind))


def _bases(side: _Side, kind: Any) -> list[str] | None:
    """Returns the base types that an element consists of; None if its size is not fixed."""
    name, argument = kind
    if name == _BASE:
        return None if argument[0] == "string" else [argument[0]]
    if name == _SEQUENCE:
        return None
    if name == _ARRAY:
        inner = _bases(side, argument[0])
        return None if inner is None else inner * argument[1]
    found: list[str] = []
    for _, field in side.fields(argument):
        inner = _bases(side, field)
        if inner is None:
            return None
        found += inner
    return found


def _least_size(side: _Side, kind: Any) -> int:
    name, argument = kind
    if name == _NAME:
        return sum(_least_size(side, field) for _, field in side.fields(argument))
    if name == _ARRAY:
        return _least_size(side, argument[0]) * int(argument[1])
    if name == _SEQUENCE or argument[0] == "string":
        return _LENGTH
    return _SIZES[argument[0]]


def _without_header(data: memoryview) -> memoryview:
    if data[:2] != _CDR_HEADER[:2]:
        raise MalformedError(f"it is not little-endian CDR: it begins with {bytes(data[:4]).hex()}")
    return data[len(_CDR_HEADER) :]


def _ends_early(position: int, size: int) -> MalformedError:
    if position > size:
        return MalformedError(f"it ends after {size} bytes, within a field that ends at {position}")
    return MalformedError(f"its fields end after {position} of {size} bytes")


def _too_many(count: int) -> MalformedError:
    return MalformedError(f"it is too short for a sequence of {count} elements")
