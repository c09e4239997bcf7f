"""Reaching into Cyclone's memory: what cannot be read is no crash, and another layout is an error."""

import ctypes

import pytest

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

from pioneer_ros2.error import DoorError
from pioneer_ros2.matching import _Memory, _replace_operations


def test_addresses_that_cannot_be_read_are_zero_or_empty() -> None:
    memory = _Memory()
    for address in (0, 8, 3, 2**47, 2**63):
        assert memory.word(address) == 0
        assert memory.text(address) == b""
        assert not memory.is_code(address)


def test_words_and_texts_of_the_process_are_read() -> None:
    text = ctypes.create_string_buffer(b"DDS::Builtin", 128)
    word = ctypes.c_uint64(ctypes.addressof(text))
    memory = _Memory()
    assert memory.word(ctypes.addressof(word)) == ctypes.addressof(text)
    assert memory.text(ctypes.addressof(text)) == b"DDS::Builtin"
    function = ctypes.cast(ctypes.pythonapi.Py_GetVersion, ctypes.c_void_p).value
    assert memory.is_code(function or 0)
    assert not memory.is_code(ctypes.addressof(text))


def test_a_type_whose_table_has_no_functions_stays_as_it_is() -> None:
    table = (ctypes.c_uint64 * 40)()
    sertype = (ctypes.c_uint64 * 8)()
    sertype[1] = ctypes.addressof(table)
    with pytest.raises(DoorError, match="keeps the description of types elsewhere"):
        _replace_operations(_Memory(), ctypes.addressof(sertype))
    assert sertype[1] == ctypes.addressof(table)
