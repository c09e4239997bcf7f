"""A hub with a password: who has it works as ever, who has not is told once."""

import time
from pathlib import Path

import pytest

from pioneer_harness.wait import START, wait_until

# rosmaster, in our process here, leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning")

SECRET, OTHER = "open sesame", "open barley"


def variables(folder: Path, password: str) -> dict[str, str]:
    path = folder / password.replace(" ", "-")
    path.write_text(password + "\n")
    return {"ROCON_HUB_PASSWORD_FILE": str(path)}


def test_gateways_with_the_hubs_password_connect_and_keep_it_to_themselves(fleet, tmp_path) -> None:
    right = variables(tmp_path, SECRET)
    fleet.start_hub(right)
    base, robot = (fleet.site(name).start(right).connected() for name in ("base", "robot"))
    robot.talk("/scan")
    ear = base.hear("/scan")
    assert base.flip("robot", "subscriber", "/scan") == 0
    ear.first_after(0.0)
    assert not [log for log in tmp_path.glob("*.log") if SECRET in log.read_text()]


@pytest.mark.parametrize(
    ("hubs", "ours", "said"),
    [
        (SECRET, OTHER, "wants another password"),
        (SECRET, "", "wants a password"),
        ("", OTHER, "has no password"),
    ],
    ids=["wrong", "missing", "needless"],
)
def test_a_password_that_does_not_fit_is_one_line(fleet, tmp_path, hubs, ours, said) -> None:
    fleet.start_hub(variables(tmp_path, hubs) if hubs else None)
    site = fleet.site("base").start(variables(tmp_path, ours) if ours else None)
    wait_until(lambda: said in site.log.read_text(), said, START)
    # It goes on trying, twice a second.
    told = time.monotonic()
    wait_until(lambda: time.monotonic() - told > 2.5, "some more tries", 5)
    lines = [line for line in site.log.read_text().splitlines() if f":{fleet.hub_port}" in line]
    # The gateway may have been there first.
    (line,) = [line for line in lines if "refused" not in line]
    assert "ROCON_HUB_PASSWORD_FILE" in line
    assert not site.info().connected
