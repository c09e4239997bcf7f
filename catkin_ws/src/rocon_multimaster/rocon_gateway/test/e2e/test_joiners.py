"""Late and early joiners: hub, gateways, nodes and rule may come in any order, and a message arrives in the end."""

import itertools
import time
from collections.abc import Callable

import pytest
from gateway_msgs import msg

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

ORDERS = (
    "hub base robot talker listener rule",
    "listener talker robot base rule hub",
    "base rule robot hub talker listener",
    "talker base listener hub rule robot",
)


def test_each_part_comes_before_and_after_each_other_in_some_order() -> None:
    seen = {pair for order in ORDERS for pair in itertools.combinations(order.split(), 2)}
    # A rule is requested from the gateway that holds it, so it cannot come before that gateway.
    assert seen == set(itertools.permutations(ORDERS[0].split(), 2)) - {("rule", "base")}


@pytest.mark.parametrize("order", ORDERS)
def test_parts_may_come_in_any_order(fleet, report, order: str) -> None:
    # The original's hub could not keep track of gateways with these names.
    base, robot = fleet.site("Hub Gateway"), fleet.site("robot:*?[1]")
    ears = []
    steps: dict[str, Callable[[], object]] = {
        "hub": fleet.start_hub,
        "base": base.start,
        "robot": robot.start,
        "talker": lambda: robot.talk("/chatter"),
        "listener": lambda: ears.append(base.hear("/chatter")),
        "rule": lambda: flip(base, robot.name),
    }
    for step in order.split():
        steps[step]()
    joined = time.monotonic()
    report(f"message after '{order}'", ears[0].first_after(joined, timeout=30))
    wait_until(lambda: base.states() == {"flip /chatter": "active"}, "active", 5)


def flip(base, gateway: str) -> None:
    assert base.flip(gateway, "subscriber", "/chatter") == msg.ErrorCodes.SUCCESS
