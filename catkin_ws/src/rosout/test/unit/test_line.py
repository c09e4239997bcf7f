"""The form of a message in the log file."""

from rosgraph_msgs.msg import Log

from rosout.line import line_of


def message(**fields: object) -> Log:
    log = Log(level=Log.WARN, name="/x", msg="a\nb", file="f.cpp", function="f", line=7, **fields)
    log.header.stamp.secs, log.header.stamp.nsecs = 12, 34
    return log


def test_a_line_has_the_original_s_form() -> None:
    both = message(topics=["/a", "/b"])
    assert line_of(both) == "12.000000034 WARN /x [f.cpp:7(f)] [topics: /a, /b] a\nb"
    assert line_of(both, with_topics=False) == "12.000000034 WARN /x [f.cpp:7(f)] a\nb"


def test_an_unknown_level_is_its_number() -> None:
    assert line_of(Log(level=3)).startswith("0.000000000 3 ")
