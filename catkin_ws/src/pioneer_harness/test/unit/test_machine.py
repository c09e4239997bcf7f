"""Other machines, each connected by its own cable."""

import subprocess

import pytest

from pioneer_harness.machine import FarMachine, MachineError


@pytest.fixture
def machines():
    made = []
    try:
        try:
            made.extend(FarMachine() for _ in range(2))
        except MachineError as error:
            pytest.skip(f"other machines are not tested here: {error}")
        yield made
    finally:
        for machine in made:
            machine.close()


def test_two_at_once_have_addresses_of_their_own(machines):
    assert len({address for machine in machines for address in (machine.here, machine.there)}) == 4
    for machine in machines:
        machine.run(
            "python3", "-c", f"import socket; socket.create_server(({machine.there!r}, 0)).close()"
        )


def test_one_that_is_closed_leaves_nothing_and_its_address_to_the_next(machines):
    first = machines.pop(0)
    first.close()
    assert (
        first.name
        not in subprocess.run(
            ["ip", "netns"], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    machines.append(FarMachine())
    assert machines[-1].here == first.here
