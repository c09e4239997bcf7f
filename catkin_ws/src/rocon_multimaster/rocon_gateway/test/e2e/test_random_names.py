"""Gateways, topics and nodes with names of 1 to 255 random characters: they work, or are refused with one line."""

import random
import re
import string

import pytest

from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

LENGTHS = (1, 2, 54, 55, 63, 64, 128, 229, 230, 254, 255)
PLAIN = string.ascii_letters + string.digits + "_"
POOLS = (
    PLAIN,
    PLAIN + "/~-.",
    PLAIN + " ,;:=@#%&!?'\"`$^*+|\\()[]{}<>",
    "äöüßéñøŁžğİıΩλЖ中文日本語한국어עברית",
    "🤖🚗👩‍🔬" + PLAIN,
    PLAIN + "\t\n\r\x00\x07\x1b\x7f\u200b\u202e\ufeff",
)


def drawn_name(drawn: random.Random, length: int) -> str:
    return "".join(drawn.choices(drawn.choice(POOLS), k=length))


@pytest.mark.parametrize("seed", range(3))
def test_a_gateway_with_a_random_name_joins_or_ends_with_one_line(
    standing_fleet, standing, seed
) -> None:
    base, _ = standing
    drawn = random.Random(seed)
    refused = []
    for number, length in enumerate(drawn.sample(LENGTHS, 5)):
        name = drawn_name(drawn, length)
        site = standing_fleet.site(f"drawn{seed}-{number}")
        try:
            argv = ["rosrun", "rocon_gateway", "gateway"]
            parameters = {
                "name": name,
                "disable_uuids": True,
                "firewall": False,
                "hub_uri": standing_fleet.hub_uri,
            }
            site.master.set_param("/gateway", parameters)
        except Exception as error:  # noqa: BLE001 - a character that XML cannot carry
            refused.append(f"{name!r} cannot be set as a parameter: {error}")
            standing_fleet.sites.remove(site)
            site.master.stop()
            continue
        environment = site.master.environment
        site.pid = standing_fleet.group.start(site.name, argv, environment, site.log, may_end=True)
        wait_until(
            lambda s=site: s._starts() or not standing_fleet.group.is_running(s.name),
            f"the start or end of {name!r}",
            START,
        )
        text = site.log.read_text()
        assert "Traceback" not in text, text
        if not site._starts():
            faults = [line for line in text.splitlines() if "FATAL" in line or "ERROR" in line]
            assert len(faults) == 1, text
            refused.append(faults[0])
            continue
        site.connected()
        own = site.info().name
        assert base.flip(re.escape(own), "subscriber", f"/drawn{number}") == 0
        wait_until(
            lambda n=number: base.states()[f"flip /drawn{n}"].startswith("no such topic"),
            f"{own!r} known to others, not {base.states()}",
            10,
        )
    assert len(refused) < 5, refused


@pytest.mark.parametrize("seed", range(3))
def test_a_rule_with_random_names_is_taken_or_refused_and_the_gateway_goes_on(
    standing, seed
) -> None:
    base, robot = standing
    drawn = random.Random(seed)
    taken = 0
    for length in LENGTHS:
        name, node = drawn_name(drawn, length), drawn_name(drawn, length)
        for kind in ("publisher", "subscriber", "service", "parameter"):
            for act in (base.flip, base.pull):
                if act("robot", kind, name, node) == 0:
                    taken += 1
                    assert act("robot", kind, name, node, cancel=True) == 0
    assert taken > 0
    assert base.states() == {}
    robot.talk("/after")
    assert base.flip("robot", "subscriber", "/after") == 0
    wait_until(lambda: base.states()["flip /after"] == "active", "a rule afterwards", 10)
