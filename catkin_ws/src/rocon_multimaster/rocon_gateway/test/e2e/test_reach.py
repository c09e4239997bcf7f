"""What another machine on the network can reach of a gateway."""

import subprocess
import sys

import pytest

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

CONNECT = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 3)"


def is_reached(machine, port: int) -> bool:
    """Returns whether the other machine can connect to one of our ports."""
    argv = [*machine.prefix, sys.executable, "-c", CONNECT, machine.here, str(port)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert done.returncode == 0 or "ConnectionRefusedError" in done.stderr, done.stderr
    return done.returncode == 0


@pytest.mark.parametrize(
    "variables", [{}, {"ROS_IP": "127.0.0.1"}, {"ROS_IP": ""}], ids=["", "loopback", "any"]
)
def test_without_a_credential_no_other_machine_reaches_a_relay(fleet, machine, variables) -> None:
    """Any host on the network that guessed two names could once read topics and call services."""
    fleet.start_hub()
    site = fleet.site("base").start(variables).connected()
    assert not is_reached(machine, site.relay_port())
    assert "only gateways on this machine can link to this one" in site.log.read_text()


@pytest.mark.parametrize("how", ["password", "insecure"])
def test_with_a_password_or_where_the_user_insists_other_machines_reach_a_relay(
    fleet, machine, tmp_path, how
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("open sesame")
    variables = {"ROCON_HUB_PASSWORD_FILE": str(secret)} if how == "password" else {}
    fleet.start_hub(variables)
    site = fleet.site("base").start(variables, insecure=how == "insecure").connected()
    assert is_reached(machine, site.relay_port())
    assert ("INSECURE" in site.log.read_text()) == (how == "insecure")
