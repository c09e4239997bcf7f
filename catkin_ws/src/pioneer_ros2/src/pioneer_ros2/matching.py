"""The one place that reaches into Cyclone's memory: topics whose endpoints match by the name of their type.

ROS 2 Kilted's Fast DDS describes its types to peers. Cyclone 11 cannot read these descriptions where a type has
sequences ("invalid type object"), and an endpoint that it cannot compare never matches. If our side has no description,
both sides compare names only, as Cyclone's own layer for ROS 2 does. The Python binding always sends a description,
which it keeps behind the sample's class in its C structure:

    ddsi_sertype …, PyObject *class, flags, char *type_info, uint32_t size, char *type_map, uint32_t size, …

Both pointers are set to null once the topic exists, which the binding's code treats as "no description". Every field is
checked first, so that another layout in another version is an error and no crash.
"""

import ctypes
from typing import Any

from cyclonedds.internal import DDS

from pioneer_ros2.error import DoorError

_WORDS = 40
"""Longest distance of the class from the structure's start, in words of eight bytes."""
_LOW_HALF = 0xFFFFFFFF
_MOVED = "this version of Cyclone DDS keeps the description of types elsewhere"


def match_by_name(topic: Any) -> None:
    """Takes the type's description off a topic that has no endpoints yet.

    The binding shares one structure among topics of one class, and fails on a second topic without a description: each
    topic needs a class of its own.

    Raises:
        DoorError: this version of Cyclone keeps it elsewhere.
    """
    address = ctypes.c_void_p()
    get = DDS._dll_handle.dds_get_entity_sertype
    get.argtypes = [ctypes.c_int32, ctypes.POINTER(ctypes.c_void_p)]
    if get(topic._ref, ctypes.byref(address)) != 0 or not address.value:
        raise DoorError("this version of Cyclone DDS does not say where a topic's type is")
    words = (ctypes.c_uint64 * (_WORDS + 6)).from_address(address.value)
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
