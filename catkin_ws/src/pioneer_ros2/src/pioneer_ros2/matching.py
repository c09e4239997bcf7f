"""The one place that reaches into Cyclone's memory: topics whose endpoints match by the name of their type.

ROS 2 Kilted's Fast DDS describes its types to peers. Cyclone 11 cannot read these descriptions where a type has
sequences ("invalid type object"), and an endpoint that it cannot compare never matches. If our side has no description,
both sides compare names only, as Cyclone's own layer for ROS 2 does. The Python binding always sends a description,
which it keeps behind the sample's class in its C structure:

    ddsi_sertype …, PyObject *class, flags, char *type_info, uint32_t size, char *type_map, uint32_t size, …

Both pointers are set to null once the topic exists, which the binding's code treats as "no description". Every field is
checked first, so that another layout in another version is an error and no crash.

That is not enough where ROS 2 has several participants. They describe types to one another, in replies that Cyclone
gets too. A reply that it cannot read marks the type as invalid, and from then on Cyclone takes no endpoint of that
type: a node that comes later would not get the map. Replies are therefore dropped on arrival, see
`ignore_type_descriptions`.
"""

import bisect
import ctypes
from pathlib import Path
from typing import Any

from cyclonedds.internal import DDS

from pioneer_ros2.error import DoorError

_WORDS = 40
"""Longest distance of the class from the structure's start, in words of eight bytes."""
_LOW_HALF = 0xFFFFFFFF
_TYPE_NAME, _DOMAIN = 4, 5
"""Words of ``ddsi_sertype``: its type's name, and the state of the domain."""
_SERDATA_OPERATIONS = 1
"""Word of ``ddsi_sertype``: the table of functions for its samples."""
_FROM_NETWORK = 2
"""Entry of that table: the function that makes a sample of received bytes."""
_OPERATIONS = 32
"""Entries that are copied, more than the table has."""
_DOMAIN_WORDS = 2048
"""Length of the domain's state that is searched, in words."""
_REPLY = b"DDS::Builtin::TypeLookup_Reply"
_MOVED = "this version of Cyclone DDS keeps the description of types elsewhere"


_Refuse = ctypes.CFUNCTYPE(ctypes.c_void_p)


@_Refuse
def _no_sample() -> None:
    """Takes the place of Cyclone's function: no sample, the received bytes are dropped."""
    return


def ignore_type_descriptions(topic: Any) -> None:
    """Makes the domain of a topic drop descriptions of types that it receives.

    Raises:
        DoorError: this version of Cyclone keeps its types elsewhere.
    """
    memory = _Memory()
    own = _sertype(topic)
    name = memory.text(memory.word(own + 8 * _TYPE_NAME))
    if name != topic.data_type.__idl__.idl_transformed_typename.encode():
        raise DoorError(_MOVED)
    domain = memory.word(own + 8 * _DOMAIN)
    for index in range(_DOMAIN_WORDS):
        sertype = memory.word(domain + 8 * index)
        if memory.text(memory.word(sertype + 8 * _TYPE_NAME)) == _REPLY:
            _replace_operations(memory, sertype)
            return
    raise DoorError(_MOVED)


def _replace_operations(memory: "_Memory", sertype: int) -> None:
    """Gives a type a table of functions of its own, in which received bytes become no sample."""
    table = memory.word(sertype + 8 * _SERDATA_OPERATIONS)
    copied = (ctypes.c_uint64 * _OPERATIONS)()
    for index in range(_OPERATIONS):
        copied[index] = memory.word(table + 8 * index)
    refuse = ctypes.cast(_no_sample, ctypes.c_void_p).value or 0
    if not all(memory.is_code(copied[index]) for index in range(_FROM_NETWORK + 1)):
        raise DoorError(_MOVED)
    copied[_FROM_NETWORK] = refuse
    _KEPT.append(copied)
    ctypes.c_uint64.from_address(sertype + 8 * _SERDATA_OPERATIONS).value = ctypes.addressof(copied)


_KEPT: list[Any] = []
"""Tables that Cyclone uses."""


class _Memory:
    """What of the process's memory can be read, so that a wrong pointer is no crash."""

    def __init__(self) -> None:
        self._starts: list[int] = []
        self._ranges: list[tuple[int, bool]] = []  # end, and whether it has code
        for line in Path("/proc/self/maps").read_text().splitlines():
            span, rights = line.split()[:2]
            start, end = (int(number, 16) for number in span.split("-"))
            if rights[0] == "r" and "[v" not in line:
                self._starts.append(start)
                self._ranges.append((end, rights[2] == "x"))

    def _range(self, address: int, size: int) -> tuple[int, bool]:
        """Returns the end of the readable range that has these bytes, and whether it is code; (0, False) for none."""
        index = bisect.bisect_right(self._starts, address) - 1
        if index < 0 or self._ranges[index][0] < address + size:
            return (0, False)
        return self._ranges[index]

    def word(self, address: int) -> int:
        """Returns the word at an address; 0 if it cannot be read."""
        if address % 8 or not self._range(address, 8)[0]:
            return 0
        return ctypes.c_uint64.from_address(address).value

    def text(self, address: int) -> bytes:
        """Returns the text at an address, up to its NUL or 64 bytes; empty if it cannot be read."""
        if not self._range(address, 64)[0]:
            return b""
        return ctypes.string_at(address, 64).partition(b"\0")[0]

    def is_code(self, address: int) -> bool:
        """Returns whether an address is of code."""
        return self._range(address, 1)[1]


def _sertype(topic: Any) -> int:
    """Returns the address of a topic's C structure."""
    address = ctypes.c_void_p()
    get = DDS._dll_handle.dds_get_entity_sertype
    get.argtypes = [ctypes.c_int32, ctypes.POINTER(ctypes.c_void_p)]
    if get(topic._ref, ctypes.byref(address)) != 0 or not address.value:
        raise DoorError("this version of Cyclone DDS does not say where a topic's type is")
    return address.value


def match_by_name(topic: Any) -> None:
    """Takes the type's description off a topic that has no endpoints yet.

    The binding shares one structure among topics of one class, and fails on a second topic without a description: each
    topic needs a class of its own.

    Raises:
        DoorError: this version of Cyclone keeps it elsewhere.
    """
    words = (ctypes.c_uint64 * (_WORDS + 6)).from_address(_sertype(topic))
    structs = [index for index in range(_WORDS) if words[index] == id(topic.data_type)]
    type_info, type_map = topic.data_type.__idl__._xt_bytedata
    if not structs:
        raise DoorError(_MOVED)
    start = structs[0]
    sizes = (words[start + 3] & _LOW_HALF, words[start + 5] & _LOW_HALF)
    if sizes != (len(type_info), len(type_map)):
        raise DoorError(_MOVED)
    for offset in (2, 4):
        words[start + offset] = 0
    for offset in (3, 5):
        words[start + offset] &= ~_LOW_HALF
