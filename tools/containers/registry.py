"""The registry from which a swarm's nodes pull the fleet's image: the user's, or one started here."""

import contextlib
import http.client
import json
import os
from collections.abc import Sequence

from containers.engine import ContainerError, output, say
from containers.image import ensure_registry_image
from containers.swarm import Node, awaited

PORT = 5000
ANSWER = 60.0
"""Time-out for the registry's first answer [s]."""
CONTAINER = "pioneer-registry"
"""Name of the registry's container on the manager, and of its image and volume."""
VOLUME = f"{CONTAINER}:/var/lib/docker-registry"
ADDRESS = "pioneer.address"
"""Container label with the manager's address on which the registry listens."""


def distribute(address: str, manager: Node, nodes: Sequence[Node]) -> str:
    """Pushes the fleet's image to the registry at ``address``, HOST:PORT, else to ours; returns the image's name there.

    Raises:
        ContainerError: the registry cannot be started or refuses the image, or a node cannot pull from it.
    """
    image = os.environ.get("PIONEER_IMAGE", "pioneer")
    # The tag identifies the image, so that an update is recognised and a node that has the image pulls nothing.
    tag = (
        output("docker", "image", "inspect", "-f", "{{.Id}}", image)
        .strip()
        .removeprefix("sha256:")[:12]
    )
    to = address
    if not address:
        address, to = f"{manager.address}:{PORT}", f"127.0.0.1:{PORT}"
        for node in nodes:
            if node != manager:
                check_trust(node, address)
        _start(manager.address)
    name, pushed = f"{address}/pioneer:{tag}", f"{to}/pioneer:{tag}"
    for one in (name, pushed):
        output("docker", "tag", image, one)
    say(f"pushing the image to {address}")
    output("docker", "push", "-q", pushed)
    return name


def check_trust(node: Node, address: str) -> None:
    """Raises ContainerError if a node's engine requires TLS from our registry, which does not support it."""
    found = json.loads(output(*node.docker, "info", "-f", "{{json .RegistryConfig.IndexConfigs}}"))
    if found.get(address, {}).get("Secure", True):
        raise ContainerError(
            f'{node.name} takes no image from {address}: add "insecure-registries": ["{address}"] to its '
            "/etc/docker/daemon.json and restart Docker there, or name a registry with --registry HOST:PORT"
        )


def _start(address: str) -> None:
    """Starts our registry unless it runs; replaces one on a former address. It outlives fleets."""
    fields = f'{{{{.Label "{ADDRESS}"}}}} {{{{.State}}}}'
    there = output(
        "docker", "ps", "-a", "--filter", f"name=^{CONTAINER}$", "--format", fields
    ).split()
    if there and there[0] != address:
        output("docker", "rm", "-f", CONTAINER)
    if not there or there[0] != address:
        ensure_registry_image(CONTAINER)
        published = [
            word for host in ("127.0.0.1", address) for word in ("-p", f"{host}:{PORT}:{PORT}")
        ]
        words = ["--label", f"{ADDRESS}={address}", "--restart", "unless-stopped", "-v", VOLUME]
        output("docker", "run", "-d", "--name", CONTAINER, *published, *words, CONTAINER)
    elif there[1] != "running":
        output("docker", "start", CONTAINER)
    if not awaited(_answers, ANSWER):
        raise ContainerError(
            f"the registry does not answer after {ANSWER:g} s: docker logs {CONTAINER}"
        )


def _answers() -> bool:
    line = http.client.HTTPConnection("127.0.0.1", PORT, timeout=5.0)
    with contextlib.closing(line):
        try:
            line.request("GET", "/v2/")
            return line.getresponse().status == http.client.OK
        except (OSError, http.client.HTTPException):
            return False
