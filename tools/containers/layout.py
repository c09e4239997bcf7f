"""The compose file for any number of robots: docker/compose.yaml with the block of aadi1 repeated."""

import re
from pathlib import Path

from containers.engine import ContainerError

MOST = 150
"""Robots that fit the tutorial's addresses, 192.168.2.101 to 250."""


def compose_text(shipped: str, robots: int) -> str:
    """Returns the compose file for so many robots, from the text of the shipped one.

    Raises:
        ContainerError: no such fleet.
    """
    if not 1 <= robots <= MOST:
        raise ContainerError(f"--robots must be 1 to {MOST}, not {robots}")
    blocks = re.compile(r"(?:^  aadi\d+:\n(?:^    .*\n)+\n?)+", re.M)
    first = re.search(r"^  aadi1:\n(?:^    .*\n)+\n?", shipped, re.M)
    assert first is not None, "the shipped file has a first robot"
    block = first[0]
    return blocks.sub(lambda _: "".join(_block(block, number) for number in range(1, robots + 1)), shipped, count=1)


def _block(first: str, number: int) -> str:
    return first.replace("aadi1:", f"aadi{number}:").replace("hostname: aadi1", f"hostname: aadi{number}").replace(
        "}.101", f"}}.{100 + number}"
    )  # fmt: skip


def write_compose(shipped: Path, target: Path, robots: int) -> None:
    """Writes the compose file for so many robots."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(compose_text(shipped.read_text(), robots))
