"""Names and defaults that launch files and clients written for rocon rely on."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

from rocon_gateway.node.config import GatewayConfig

MULTIMASTER = Path(__file__).parents[3]

GATEWAY_LAUNCH = {
    "gateway_name": "gateway",
    "gateway_watch_loop_period": "5",
    "gateway_hub_uri": "",
    "gateway_hub_whitelist": "[]",
    "gateway_disable_uuids": "false",
    "gateway_firewall": "true",
    "gateway_disable_zeroconf": "false",
    "gateway_custom_rules_file": "",
    "gateway_network_interface": "$(optenv GATEWAY_NETWORK_INTERFACE)",
}
HUB_LAUNCH = {
    "hub_name": "Rocon Hub",
    "hub_port": "6380",
    "zeroconf": "true",
    "gateway_gone_timeout": "30",
    "hub_watcher_thread_rate": "0.2",
}
PARAMETERS = {
    "hub_uri": "",
    "name": "gateway",
    "watch_loop_period": 10,
    "firewall": True,
    "disable_zeroconf": False,
    "disable_uuids": False,
    "network_interface": "",
    "custom_rules_file": "",
}
LISTS = (
    "hub_whitelist",
    "hub_blacklist",
    "default_blacklist",
    "default_advertisements",
    "default_flips",
    "default_pulls",
    "advertise_all",
)
BLACKLIST = """
    publisher /rosout.* subscriber /rosout.* service .*get_loggers service .*set_logger_level publisher /tf
    subscriber /tf publisher .*zeroconf.* subscriber .*zeroconf.* service .*zeroconf.* service .*gateway/.*
    publisher .*gateway/.* subscriber .*gateway/.* publisher .*connection_cache/.* subscriber .*connection_cache/.*
"""


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("rocon_gateway/launch/gateway.launch", GATEWAY_LAUNCH),
        ("rocon_hub/launch/hub.launch", HUB_LAUNCH),
    ],
)
def test_the_launch_files_have_rocons_arguments_with_their_defaults(
    file: str, expected: dict[str, str]
) -> None:
    found = {
        one.get("name"): one.get("default")
        for one in ET.parse(MULTIMASTER / file).getroot().iter("arg")
    }
    assert expected.items() <= found.items()


def test_the_node_has_rocons_parameters_with_their_defaults() -> None:
    config = GatewayConfig()
    assert {name: getattr(config, name) for name in PARAMETERS} == PARAMETERS
    assert not any(getattr(config, name) for name in LISTS)


def test_the_default_blacklist_is_rocons() -> None:
    rows = yaml.safe_load((MULTIMASTER / "rocon_gateway/config/default_blacklist.yaml").read_text())
    words = BLACKLIST.split()
    expected = sorted(zip(words[::2], words[1::2], strict=True))
    assert sorted((row["type"], row["name"]) for row in rows["default_blacklist"]) == expected
