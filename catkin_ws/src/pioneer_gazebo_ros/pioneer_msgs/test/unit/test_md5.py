"""The definition matches that of the real driver: the same bytes on the wire."""

from pioneer_msgs.msg import BumperState


def test_bumper_state_has_the_md5_of_rosarias() -> None:
    assert BumperState._md5sum == "f81947761ff7e166a3bbaf937b9869b5"
