"""A swarm of two engines on this machine, without a fleet: the data about its nodes, and what ``up`` refuses."""

import http.client
import io
import os
import re
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from tested_fleet import Fleet, cut, fleet, may_have_base, mend

from containers.engine import DOCKER, ContainerError, output
from containers.hosts import MANAGER, Host, is_in_swarm, swarm_here
from containers.registry import PORT, distribute
from containers.swarm import check_engines, nodes
from pioneer_harness.wait import wait_until

NOTICED = 60.0
"""Time limit for the swarm to mark an unreachable machine as down [s]; usually 10 to 20 s, more on a busy machine."""
ADDRESS = "127.0.0.1:9"
"""There is no registry at this address."""


@pytest.fixture(scope="module")
def host() -> Iterator[Host]:
    if os.geteuid() != 0 or is_in_swarm():
        pytest.skip(
            "a swarm of engines in network namespaces needs root, and an engine that is in no swarm"
        )
    with swarm_here(1) as (made,):
        made.join()
        yield made


@pytest.fixture(scope="module")
def on_swarm(host: Host) -> Iterator[Fleet]:
    with fleet("pioneer-swarm", "10.88.12") as made:
        yield made


def test_each_node_is_known_with_the_way_to_its_engine(host: Host) -> None:
    may_have_base(host)
    here, other = nodes()
    check_engines([here, other])
    assert (here.docker, here.works, here.base) == (DOCKER, True, False)
    assert (other.name, other.docker) == (host.name, ("docker", "--context", host.name))
    assert (other.works, other.base, other.processors) == (True, True, here.processors)


def test_an_image_that_does_not_exist_is_reported_in_one_line(on_swarm: Fleet) -> None:
    said = on_swarm.refused("up", "--swarm", "--robots", "2", PIONEER_IMAGE="pioneer-mistyped")
    assert "No such image: pioneer-mistyped" in said


def test_a_registry_that_does_not_answer_is_reported_in_one_line(on_swarm: Fleet) -> None:
    try:
        said = on_swarm.refused("up", "--swarm", "--robots", "2", "--registry", ADDRESS)
    finally:
        tags = output(
            "docker",
            "images",
            "--filter",
            f"reference={ADDRESS}/*",
            "--format",
            "{{.Repository}}:{{.Tag}}",
        )
        output("docker", "rmi", *tags.split())
    assert re.search(rf"docker push .*failed: .*{ADDRESS}.*refused", said), said


@pytest.fixture
def tiny_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Yields an image of one small file, in the place of the fleet's."""
    name, layer = "pioneer-tiny", tmp_path / "layer.tar"
    with tarfile.open(layer, "w") as archive:
        archive.addfile(tarfile.TarInfo("empty"), io.BytesIO())
    output("docker", "import", str(layer), name)
    monkeypatch.setenv("PIONEER_IMAGE", name)
    yield name
    output("docker", "rmi", name)


_WRITES = """
import http.client, sys
for method, path in (("POST", "blobs/uploads/"), ("PUT", "manifests/latest"), ("DELETE", "manifests/latest")):
    line = http.client.HTTPConnection(sys.argv[1], timeout=20)
    line.request(method, f"/v2/pioneer/{path}", body=b"{}")
    print(line.getresponse().status)
"""


def test_other_machines_pull_from_the_registry_and_cannot_push_to_it(
    host: Host, tiny_image: str
) -> None:
    """Any machine of the manager's LAN could push a fleet's image in the place of the true one."""
    other, address = ("docker", "--context", host.name), f"{MANAGER}:{PORT}"
    name = distribute("", nodes()[0], nodes())
    output(*other, "pull", name)
    pulled, pushed = (
        output(*engine, "image", "inspect", "-f", "{{.Id}}", image)
        for engine, image in ((other, name), (DOCKER, tiny_image))
    )
    assert pulled == pushed
    for image in (name, f"{address}/pioneer:theirs"):
        output(*other, "tag", name, image)
        with pytest.raises(ContainerError, match=r"docker .*failed"):
            output(*other, "push", "-q", image)
    outside = ["ip", "netns", "exec", host.link, "python3", "-c", _WRITES, address]
    said = subprocess.run(outside, capture_output=True, text=True, check=True).stdout
    assert said.split() == [str(http.client.METHOD_NOT_ALLOWED)] * 3


def test_a_machine_whose_cable_is_out_or_that_died_is_down_until_it_is_back(host: Host) -> None:
    def is_up() -> bool:
        return next(one.up for one in nodes() if one.name == host.name)

    for fault, remedy in ((cut, mend), (Host.kill, Host.start)):
        fault(host)
        wait_until(lambda: not is_up(), f"{host.name} down", NOTICED)
        remedy(host)
        wait_until(is_up, f"{host.name} up again", NOTICED)
