import pytest

from pioneer_launch.program import early_differences, interpreter


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"#!/usr/bin/python3\n", "/usr/bin/python3"),
        (b"#!/usr/bin/env python3\n", "/venv/bin/python3"),
        (b"#!/usr/bin/env bash\n", ""),
        (b"#!/usr/bin/python3 -u\n", ""),
        (b"\x7fELF\x02\x01", ""),
        (b"", ""),
    ],
)
def test_interpreter_is_what_the_first_line_names(line: bytes, expected: str) -> None:
    assert interpreter(line, {"python3": "/venv/bin/python3"}) == expected


def test_only_variables_that_an_interpreter_reads_at_its_start_count() -> None:
    ours = {"PATH": "/bin", "PYTHONPATH": "/a", "LC_ALL": "C", "ROS_NAMESPACE": "/x"}
    assert (
        early_differences(ours, {**ours, "PATH": "/sbin", "ROS_NAMESPACE": "/y", "NEW": "1"}) == []
    )
    assert early_differences(ours, {**ours, "PYTHONPATH": "/b", "LD_PRELOAD": "x.so"}) == [
        "LD_PRELOAD",
        "PYTHONPATH",
    ]
    assert early_differences(ours, {"PATH": "/bin", "PYTHONPATH": "/a"}) == ["LC_ALL"]
