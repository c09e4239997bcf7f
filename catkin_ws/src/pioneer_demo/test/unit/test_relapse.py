"""A node that keeps dying is reported, and so is its recovery."""

from pioneer_demo.processes.relapse import Relapses

WHO = "pioneer1/amcl"


def test_three_deaths_in_a_minute_are_a_fault_with_the_last_reason() -> None:
    relapses = Relapses()
    assert [relapses.died(1, WHO, f"exit code {n}", 10.0 * n) for n in range(4)] == [
        False,
        False,
        True,
        False,
    ]
    assert relapses.fails(1)
    assert relapses.faults() == [
        f"{WHO} keeps dying and is started again: 4 times so far, exit code 3"
    ]


def test_deaths_that_are_far_apart_are_no_fault() -> None:
    relapses = Relapses()
    assert not any(relapses.died(1, WHO, "killed", 40.0 * n) for n in range(10))
    assert relapses.faults() == []


def test_nodes_of_one_name_on_two_masters_are_counted_apart() -> None:
    relapses = Relapses()
    assert not any(relapses.died(master, "gateway", "killed", 0.0) for master in (1, 2, 1, 2))
    assert relapses.died(1, "gateway", "killed", 1.0)
    assert not relapses.fails(2)


def test_a_node_that_lives_for_a_minute_is_well_again_and_that_is_one_line() -> None:
    relapses = Relapses()
    for moment in (0.0, 5.0, 10.0):
        relapses.died(1, WHO, "killed", moment)
    relapses.died(2, "pioneer2/amcl", "killed", 0.0)
    assert relapses.recovered(65.0) == []
    assert relapses.recovered(71.0) == [f"{WHO} has run for 60 s and no longer keeps dying"]
    assert relapses.faults() == relapses.recovered(72.0) == []
    assert not relapses.died(1, WHO, "killed", 73.0)
