"""A fleet on three machines as its operator sees it, and its robots' behaviour, when machines join, fail and leave.

The tests build on each other, in this order: two machines, a third that joins, faults of each, a new image.
A robot is undisturbed if it reaches every waypoint of its round and its computer was never without odometry for longer
than the time after which the robot stops (`errand`).
"""

import math
import re
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest
from errand import ACROSS, ROUNDS, Errand, Errands, finishes, place
from tested_fleet import PATIENCE, Fleet, cut, may_have_base, mend

from containers.engine import Computer, output
from containers.hosts import Host
from containers.registry import CONTAINER
from pioneer_harness.wait import wait_until

BASE = "aadiworkstation"
ALL = (1, 2, 3)
CUT = 20.0
"""How long a cable is unplugged [s]: long enough for the swarm to mark the machine as down."""
AWAY = 1.0
"""A robot is on its way above this distance from the end of its round [m]."""


def robots_on(fleet: Fleet, host: Host) -> list[int]:
    return [
        one.number for one in fleet.computers().values() if one.node == host.name and one.number
    ]


def host_with_robots_only(fleet: Fleet, hosts: Sequence[Host]) -> Host:
    """Returns the host without the base station, after moving a robot's computer there if it has none."""
    computers = fleet.computers()
    (host,) = (one for one in hosts if one.name != computers[BASE].node)
    if not robots_on(fleet, host):
        nodes = [one.node for one in computers.values() if one.number]
        moved = next(one for one in computers.values() if one.number and nodes.count(one.node) > 1)
        # The swarm restarts it on the machine with the fewest tasks.
        fleet.docker("rm", moved.name, "-f")
        assert runs_elsewhere(fleet, moved).node == host.name
        fleet.report(moved.name, "--until", "ready")
    return host


def runs_elsewhere(fleet: Fleet, before: Computer) -> Computer:
    """Waits until a computer runs in a different container than before; returns it."""

    def moved() -> Computer | None:
        now = fleet.computers().get(before.name)
        return now if now and now.running and now.container != before.container else None

    found = wait_until(moved, f"start of {before.name} in another container", PATIENCE)
    assert found is not None, "it was waited for"
    return found


def containers_of(host: Host) -> set[str]:
    """Returns a host's running containers."""
    return set(output("docker", "--context", host.name, "ps", "-q", "--no-trunc").split())


def from_home(fleet: Fleet, number: int) -> float:
    """Returns a robot's distance from the start and end of its round [m]."""
    return math.dist(place(fleet, number), ROUNDS[number][-1])


def send(errands: Errands) -> dict[int, Errand]:
    """Sends all robots on their rounds; returns once they are away from the end points."""
    sent = errands.send(*ALL)
    for number in ALL:
        wait_until(
            lambda one=number: from_home(errands.fleet, one) > AWAY,
            f"pioneer{number} on its way",
            PATIENCE,
        )
    return sent


@contextmanager
def fewest_running(fleet: Fleet) -> Iterator[list[int]]:
    """Counts the running robot computers repeatedly during the context; yields the list of counts."""
    seen, over = list[int](), threading.Event()

    def look() -> None:
        while not over.wait(1.0):
            seen.append(sum(one.running for one in fleet.computers().values() if one.number))

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield seen
    finally:
        over.set()
        thread.join()


def test_robots_without_room_on_any_machine_are_reported_in_one_line(on_swarm: Fleet) -> None:
    said = on_swarm.refused("up", "--swarm", "--robots", "2", "--rtf", "30")
    names = "aadiworkstation, aadi1, aadi2"
    assert said.startswith(
        f"pioneer: the swarm has no place for {names}: no suitable node (insufficient resources"
    ), said
    on_swarm.pioneer("down")


def test_two_robots_drive_on_two_machines(errands: Errands, hosts: Sequence[Host]) -> None:
    fleet = errands.fleet
    # No tour: it might end at the place where the third robot joins.
    said = fleet.pioneer("up", "--swarm", "--robots", "2", "--rtf", "0.5", "--waypoints", "0")
    assert re.search(r"^2 robots are ready after \d+ s", said, re.M), said
    found = fleet.computers()
    assert found[BASE].node == hosts[0].name
    assert len({found["aadi1"].node, found["aadi2"].node}) == 2
    for errand in errands.send(1, 2, part=ACROSS).values():
        errand.undisturbed()


def test_a_machine_that_cannot_get_the_image_is_reported_in_one_line(
    on_swarm: Fleet, hosts: Sequence[Host]
) -> None:
    output("docker", "stop", CONTAINER)
    hosts[1].join()
    try:
        said = on_swarm.refused("up", "--robots", "3")
    finally:
        output("docker", "start", CONTAINER)
    assert said.startswith(f"pioneer: {hosts[1].name} cannot start aadi3: "), said
    assert "No such image" in said


def test_a_machine_that_joins_late_is_used_by_the_next_up(
    on_swarm: Fleet, hosts: Sequence[Host]
) -> None:
    hosts[1].join()
    said = on_swarm.pioneer("up", "--robots", "3", "--waypoints", "1")
    assert on_swarm.computers()["aadi3"].node == hosts[1].name, said
    may_have_base(hosts[1])
    for number in ALL:
        on_swarm.report(f"aadi{number}", "--until", "ready")
        on_swarm.execute(
            f"aadi{number}", "rosservice", "call", f"/pioneer{number}/map_goal_client/clear"
        )


def undisturbed(fleet: Fleet, sent: dict[int, Errand], moved: Sequence[int]) -> None:
    """Checks that robots whose computers had to move finish their rounds, and that the others are undisturbed."""
    assert moved
    for number in ALL:
        if number not in moved:
            sent[number].undisturbed()
    for number in moved:
        finishes(fleet, number)


def test_robots_of_a_drained_machine_drive_on_elsewhere(
    errands: Errands, hosts: Sequence[Host]
) -> None:
    fleet, host = errands.fleet, host_with_robots_only(errands.fleet, hosts)
    sent, before, moved = send(errands), fleet.computers(), robots_on(fleet, host)
    output("docker", "node", "update", "--availability", "drain", host.name)
    try:
        for number in moved:
            assert runs_elsewhere(fleet, before[f"aadi{number}"]).node != host.name
        undisturbed(fleet, sent, moved)
    finally:
        output("docker", "node", "update", "--availability", "active", host.name)


def test_robots_drive_while_their_image_is_replaced_one_at_a_time(
    errands: Errands, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, sent = errands.fleet, send(errands)
    before = fleet.computers()
    image = "pioneer-swarm-next"
    made = output("docker", "create", before["aadi1"].image).strip()
    monkeypatch.setitem(fleet.environment, "PIONEER_IMAGE", image)
    try:
        output("docker", "commit", "-c", "LABEL pioneer.next=1", made, image)
        with fewest_running(fleet) as running:
            fleet.pioneer("up", "--update", "--waypoints", "0")
    finally:
        output("docker", "rm", made)
        output("docker", "rmi", image)
    assert min(running) >= len(ALL) - 1, running
    now = fleet.computers()
    assert all(now[f"aadi{number}"].image != before[f"aadi{number}"].image for number in ALL)
    assert now[BASE].container == before[BASE].container
    for number in sent:
        finishes(fleet, number)


def test_a_machine_off_the_network_and_back_disturbs_no_other(
    errands: Errands, hosts: Sequence[Host]
) -> None:
    fleet = errands.fleet
    host = host_with_robots_only(fleet, hosts)
    sent, moved = send(errands), robots_on(fleet, host)
    cut(host)
    threading.Event().wait(CUT)
    mend(host)
    host.ready()
    undisturbed(fleet, sent, moved)
    left = containers_of(host) - {one.container for one in fleet.computers().values()}
    wait_until(
        lambda: not left & containers_of(host), f"end of what ran on {host.name} before", PATIENCE
    )


def test_robots_of_a_machine_that_dies_drive_on_elsewhere(
    errands: Errands, hosts: Sequence[Host]
) -> None:
    fleet = errands.fleet
    host = host_with_robots_only(fleet, hosts)
    sent, before, moved = send(errands), fleet.computers(), robots_on(fleet, host)
    host.kill()
    try:
        for number in moved:
            assert runs_elsewhere(fleet, before[f"aadi{number}"]).node != host.name
        undisturbed(fleet, sent, moved)
    finally:
        host.start()
        host.ready()


def test_all_robots_drive_in_the_next_world_when_the_base_stations_machine_dies(
    errands: Errands, hosts: Sequence[Host]
) -> None:
    fleet = errands.fleet
    before = fleet.computers()
    host = next(one for one in hosts if one.name == before[BASE].node)
    sent, lost = send(errands), robots_on(fleet, host)
    host.kill()
    assert runs_elsewhere(fleet, before[BASE]).node != host.name
    # The third robot joined the previous world: `up` spawns it in the new one and waits for all robots.
    fleet.pioneer("up", "--waypoints", "0")
    for number in set(ALL) - set(lost):
        sent[number].over()
    for errand in errands.send(*ALL).values():
        errand.reached()


@pytest.mark.parametrize("words", [("status",), ("status", "--json")])
def test_status_names_the_machine_of_each_computer(on_swarm: Fleet, words: tuple[str, ...]) -> None:
    said = on_swarm.pioneer(*words)
    for name, one in on_swarm.computers().items():
        assert one.node
        assert name in said
        assert one.node in said
