"""docker/base without a reachable registry: the image is built with debootstrap, from Debian's mirror."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from containers.engine import output

BASE = Path(__file__).parents[3] / "docker" / "base"
IMAGE = "localhost:1/pioneer-test-base:bookworm-slim"
"""No registry listens on that port."""


@pytest.fixture
def no_image() -> Iterator[None]:
    subprocess.run(["docker", "rmi", "-f", IMAGE], capture_output=True, check=False)
    yield
    subprocess.run(["docker", "rmi", "-f", IMAGE], capture_output=True, check=False)


@pytest.mark.skipif(os.geteuid() != 0, reason="debootstrap needs root")
def test_where_no_registry_answers_the_base_image_is_made_with_debootstrap(no_image: None) -> None:
    made = subprocess.run([BASE, IMAGE], capture_output=True, text=True, timeout=600, check=False)
    assert made.returncode == 0, made.stdout[-2000:] + made.stderr
    assert "connection refused); making it with debootstrap" in made.stdout
    said = output(
        "docker",
        "run",
        "--rm",
        IMAGE,
        "sh",
        "-c",
        ". /etc/os-release; echo $ID $VERSION_ID; cat /etc/apt/sources.list",
    )
    system, *sources = said.splitlines()
    assert system == "debian 12"
    assert [line.split()[2] for line in sources] == [
        "bookworm",
        "bookworm-updates",
        "bookworm-security",
    ]
    assert int(output("docker", "image", "inspect", "-f", "{{.Size}}", IMAGE)) < 100e6
    again = subprocess.run([BASE, IMAGE], capture_output=True, text=True, timeout=60, check=False)
    assert (again.returncode, again.stdout) == (0, ""), "the image exists"
