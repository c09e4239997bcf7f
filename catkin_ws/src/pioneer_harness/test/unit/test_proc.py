"""/proc's data about known processes."""

import os

import pytest

from pioneer_harness.proc import (
    ProcessState,
    arguments,
    descendants,
    has_variable,
    process_state,
    processors,
)


def test_this_process_is_read_as_the_kernel_knows_it():
    state = process_state(os.getpid())
    assert state.parent == os.getppid()
    assert state.alive
    assert state.rss > 1e6
    assert abs(state.cpu - sum(os.times()[:2])) < 0.5


def test_a_process_that_does_not_exist_is_none_and_has_no_arguments():
    assert process_state(2**22 + 1) is None
    assert arguments(2**22 + 1) == ()


def test_environment_variables_are_found_by_their_whole_value():
    assert has_variable(os.getpid(), "PATH", os.environ["PATH"]) or "PATH" not in os.environ
    assert not has_variable(os.getpid(), "PATH", "x")


def test_descendants_are_the_roots_and_all_below_them():
    tree = {2: 1, 3: 2, 4: 3, 5: 1}
    states = {pid: ProcessState(pid, parent, pid, True, 0, 0, 0, 0) for pid, parent in tree.items()}
    assert descendants(states, [2]) == {2, 3, 4}
    assert descendants(states, [9]) == set()


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, None),
        ({"cpu.max": "max 100000\n"}, None),
        ({"cpu.max": "50000 100000\n"}, 0.5),
        ({"cpu.max": "100000000 100000\n"}, None),
        ({"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, None),
        ({"cpu/cpu.cfs_quota_us": "25000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 0.25),
    ],
)
def test_processors_are_those_we_may_run_on_or_what_the_control_group_leaves(
    tmp_path, files, expected
):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert processors(tmp_path) == (expected or len(os.sched_getaffinity(0)))
