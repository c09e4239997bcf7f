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
READABLE_AT = "pioneer.readable-at"
"""Container label with the manager's address on which other machines may pull.

Registries of earlier versions lack it: they let any machine push, and are replaced.
"""
LOOPBACK = "127.0.0.1"
"""Where the manager pushes. No other machine reaches it, because the container has the manager's own network: what
Docker publishes on the loopback can be reached from the LAN by a route to the container's address."""
KIND = "Pioneer-Registry"
"""HTTP header by which the registry names itself; any other program may hold the port."""


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
        address, to = f"{manager.address}:{PORT}", f"{LOOPBACK}:{PORT}"
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
    fields = f'{{{{.Label "{READABLE_AT}"}}}} {{{{.State}}}}'
    there = output(
        "docker", "ps", "-a", "--filter", f"name=^{CONTAINER}$", "--format", fields
    ).split()
    if there and there[0] != address:
        output("docker", "rm", "-f", CONTAINER)
    if not there or there[0] != address:
        ensure_registry_image(CONTAINER)
        options = ["--network", "host", "--restart", "unless-stopped", "-v", VOLUME]
        options += [
            "--label",
            f"{READABLE_AT}={address}",
            "-e",
            f"PIONEER_ADDRESS={address}:{PORT}",
        ]
        output("docker", "run", "-d", "--name", CONTAINER, *options, CONTAINER)
    elif there[1] != "running":
        output("docker", "start", CONTAINER)
    places = {"writable": LOOPBACK, "readable": address}
    if not awaited(lambda: all(_answers(host, kind) for kind, host in places.items()), ANSWER):
        raise ContainerError(
            f"the registry does not answer after {ANSWER:g} s; does another program use port {PORT}? "
            f"docker logs {CONTAINER}"
        )


def _answers(host: str, kind: str) -> bool:
    line = http.client.HTTPConnection(host, PORT, timeout=5.0)
    with contextlib.closing(line):
        try:
            line.request("GET", "/v2/")
            answer = line.getresponse()
        except (OSError, http.client.HTTPException):
            return False
        return answer.status == http.client.OK and answer.headers[KIND] == kind
