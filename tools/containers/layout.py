"""The compose file for any number of robots: docker/compose.yaml with aadi1's block repeated; or a stack of it."""

import re

from containers.engine import ContainerError

_BLOCKS = re.compile(r"(?:^  aadi\d+:\n(?:^    .*\n)+\n?)+", re.M)
"""Matches the blocks of the robots' computers."""
MOST = 150
"""Number of robots that fit into the tutorial's addresses, 192.168.2.101 to 250."""


SUBNET, DEFAULT_SUBNET = "PIONEER_SUBNET", "192.168.2"
"""Variable with the first three numbers of the computers' addresses, and its default: the tutorial's."""
_SUBNET = re.compile(rf"\$\{{{SUBNET}:-([0-9.]+)\}}")


def subnet_of(text: str) -> str:
    """Returns the subnet of a compose file's computers when ``PIONEER_SUBNET`` is not set; empty if it names none."""
    found = _SUBNET.search(text)
    return found[1] if found else ""


def compose_text(shipped: str, robots: int, subnet: str = DEFAULT_SUBNET) -> str:
    """Returns the compose file for ``robots`` robots, made from the text of the shipped one.

    Args:
        shipped: docker/compose.yaml.
        robots: number of robots.
        subnet: addresses of the computers when ``PIONEER_SUBNET`` is not set.

    Raises:
        ContainerError: the number of robots is not possible.
    """
    if not 1 <= robots <= MOST:
        raise ContainerError(f"--robots must be 1 to {MOST}, not {robots}")
    first = re.search(r"^  aadi1:\n(?:^    .*\n)+\n?", shipped, re.M)
    assert first is not None, "the shipped file has a first robot"
    block = first[0]
    blocks = "".join(_block(block, number) for number in range(1, robots + 1))
    text = _BLOCKS.sub(lambda _: blocks, shipped, count=1)
    return _SUBNET.sub(f"${{{SUBNET}:-{subnet}}}", text)


def _block(first: str, number: int) -> str:
    return first.replace("aadi1:", f"aadi{number}:").replace("hostname: aadi1", f"hostname: aadi{number}").replace(
        "}.101", f"}}.{100 + number}"
    )  # fmt: skip


WORLD_CPUS, BASE_CPUS, ROBOT_CPUS = 0.1, 0.025, 0.11
"""Reserved processors at real time: for the world, and for each robot on the base station and on its computer. In
total no more than `factor_held` assumes (performance.md)."""
BASE_MEMORY, ROBOT_MEMORY = 400, 200
"""Reserved memory of the base station and of each robot's computer [MiB]."""
START_PERIOD, RETRIES = 300, 24
"""Time after its start during which a computer of a stack may be unhealthy [s], and number of consecutive failed
health checks allowed later, one every 5 s. A computer whose steps end has ended by itself long before."""
TLS = ("ca.crt", "tls.crt", "tls.key")


def stack_text(shipped: str, robots: int, base_on: str, factor: float) -> str:
    """Returns a swarm stack made from the text of the shipped compose file: the same computers but for their places.

    The robots are tasks of one service, so that the swarm replaces them one at a time. All computers share the fleet's
    certificate and an overlay network without access to the outside; no port is published.

    Args:
        shipped: docker/compose.yaml.
        robots: number of robots.
        base_on: placement constraint of the base station.
        factor: the world's real-time factor, which scales the reserved processors; 0 counts as 1.
    """
    speed = factor or 1.0
    computer, services, rest = re.split(
        r"\n\nservices:\n|  # Only with", shipped[shipped.index("x-computer:") :], maxsplit=2
    )
    computer = computer.replace("  restart: on-failure\n", "").replace(
        "interval: 15s", "interval: 5s"
    )
    # A task runs once it is healthy, and a swarm ends unhealthy ones: a busy machine must not look like a fault.
    computer = computer.replace("timeout: 5s", f"timeout: 20s\n    retries: {RETRIES}")
    computer = computer.replace("start_period: 60s", f"start_period: {START_PERIOD}s")
    computer = computer.replace("[hub_password]", f"[hub_password, {', '.join(TLS)}]")
    services = _BLOCKS.sub(lambda found: _first(found[0]), services)
    services = re.sub(
        r"    networks:\n      aadi\.robots:\n.*\n", "    networks: [robots]\n", services
    )
    base = _deploy(1, base_on, (WORLD_CPUS + BASE_CPUS * robots) * speed, BASE_MEMORY, "4g")
    robot = _deploy(robots, "", ROBOT_CPUS * speed, ROBOT_MEMORY, "1g")
    services = services.replace("    mem_limit: 4g\n", base).replace("    mem_limit: 1g\n", robot)
    secrets = rest.partition("\nsecrets:\n")[2].partition("  desktop_token:")[0]
    secrets += "".join(f"  {name}:\n    file: ${{PIONEER_TLS_DIRECTORY}}/{name}\n" for name in TLS)
    return (
        f'# Made of docker/compose.yaml by ./pioneer up --swarm.\nversion: "3.8"\n{computer}\n'
        "  ROCON_TLS_DIRECTORY: /run/secrets\n"
        f"\nservices:\n{services}"
        f"networks:\n  robots:\n    driver: overlay\n    internal: true\n\nsecrets:\n{secrets}"
    )


def _first(blocks: str) -> str:
    """Returns the service of all robots, made from the block of the first."""
    block = re.split(r"^(?=  aadi2:)", blocks, flags=re.M)[0]
    return block.replace("  aadi1:", "  aadi:").replace(
        "hostname: aadi1", 'hostname: "aadi{{.Task.Slot}}"'
    )


def _deploy(replicas: int, constraint: str, cpus: float, memory: int, most: str) -> str:
    placement = f'      placement: {{constraints: ["{constraint}"]}}\n' if constraint else ""
    return f"""\
    deploy:
      endpoint_mode: dnsrr
      replicas: {replicas}
      restart_policy: {{condition: any, delay: 2s}}
      update_config: {{parallelism: 1, order: stop-first, failure_action: pause}}
      resources:
        limits: {{memory: {most}}}
        reservations: {{cpus: "{cpus:.3f}", memory: {memory}m}}
{placement}"""
