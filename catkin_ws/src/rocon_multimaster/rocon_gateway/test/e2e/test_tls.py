"""A fleet with TLS: gateways with a certificate work as before; one without gets a single clear error."""

import subprocess
import sys
from pathlib import Path

import pytest

from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

SERVER = Path(__file__).parents[3] / "rocon_relay/test/node/server.py"
VARIABLE = "ROCON_TLS_DIRECTORY"


@pytest.fixture(scope="module")
def authorities(tmp_path_factory):
    return tmp_path_factory.mktemp("authorities")


def certified(folder: Path, *names: str, options: tuple[str, ...] = ()) -> list[dict[str, str]]:
    """Creates certificates as a user would; returns the environment for each machine of the fleet `folder`."""
    argv = ["rosrun", "rocon_gateway", "make_certificates", str(folder), *names, *options]
    made = subprocess.run(argv, capture_output=True, text=True, check=True).stdout
    assert all(f"{folder / name}: copy it to {name}" in made for name in names)
    return [{VARIABLE: str(folder / name)} for name in names]


def examine(site, *arguments: str, environment: dict[str, str]) -> str:
    """Returns the doctor's output."""
    argv = ["rosrun", "rocon_gateway", "doctor", *arguments]
    everything = {**site.master.environment, **environment}
    return subprocess.run(argv, env=everything, capture_output=True, text=True, check=False).stdout


def test_a_fleet_with_certificates_carries_topics_and_services_and_finds_its_hub(
    fleet, authorities
) -> None:
    at_hub, at_base, at_robot = certified(authorities / "fleet", "hub", "base", "robot")
    keys = [*authorities.glob("fleet/**/*.key")]
    assert len(keys) == 4
    assert not [key for key in keys if key.stat().st_mode & 0o077]
    fleet.start_hub(at_hub, zeroconf=True)
    base = (
        fleet.site("base")
        .start(at_base, hub_uri=fleet.hub_uri.replace("http", "rediss"))
        .connected()
    )
    robot = (
        fleet.site("robot").start(at_robot, hub_uri="", hub_whitelist=[fleet.hub_name]).connected()
    )
    assert base.info().hub_uris == [fleet.hub_uri.replace("http", "rediss")]
    robot.talk("/scan")
    ear = base.hear("/scan")
    assert base.flip("robot", "subscriber", "/scan") == 0
    ear.first_after(0.0)
    argv = [sys.executable, str(SERVER)]
    fleet.group.start("server", argv, robot.master.environment, fleet.folder / "server.log")
    assert robot.flip("base", "service", "/echo") == 0
    wait_until(
        lambda: base.master.system_state()[2].get("/echo") == ["/robot/server"],
        "the service",
        START,
    )
    argv = ["rosservice", "call", "/echo", "hello"]
    called = subprocess.run(
        argv, env=base.master.environment, capture_output=True, text=True, check=False
    )
    assert "hello" in called.stdout, called.stdout + called.stderr
    said = examine(base, environment=at_base)
    assert f"the hub is '{fleet.hub_name}'" in said, said
    assert "gateway 'robot'" in said


def test_a_gateway_without_a_certificate_is_reported_once_and_by_the_doctor(
    fleet, authorities
) -> None:
    (at_hub,) = certified(authorities / "lonely", "hub")
    said = "speaks TLS only: set ROCON_TLS_DIRECTORY to a directory with a certificate of its fleet"
    fleet.start_hub(at_hub)
    site = fleet.site("base").start()
    wait_until(lambda: said in site.log.read_text(), said, START)
    assert said in examine(
        site, "--hub", fleet.hub_uri, environment={}
    )  # meanwhile it retries twice a second
    lines = [line for line in site.log.read_text().splitlines() if f":{fleet.hub_port}" in line]
    # The gateway may have started before the hub.
    lines = [line for line in lines if "refused" not in line]
    assert len(lines) == 1, lines
    assert not site.info().connected
