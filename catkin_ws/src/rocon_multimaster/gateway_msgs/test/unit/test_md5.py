"""Message MD5 sums match those expected by clients that were written for rocon's gateway."""

import pytest
from gateway_msgs import msg, srv

MESSAGES = {
    "ConnectionType": "65d75f1bb32566bfec48966db2073c81",
    "ErrorCodes": "cc2f69c68d11f625f99f07d82c572d47",
    "Rule": "7a98759a4c27c4925840d27b3d7bcecb",
    "RemoteRule": "14f4c5aaf33b32b22c50fd514747f99f",
    "RemoteRuleWithStatus": "7892d8834068a87e345fff91adc26a5e",
    "ConnectionStatistics": "672067d5ab3e6157dcf8224022da3ee6",
    "RemoteGateway": "58607c66cd963e494a28cb3f919087f2",
    "GatewayInfo": "6813c0195882d105e9e462fe1035ed2e",
}
SERVICES = {
    "Advertise": (
        "394a2b6787bc0694573ae81a1842f14b",
        "85ef604243258e1594c5a7401f5e0339",
        "c389af2721ca403446acba93862aff4f",
    ),
    "AdvertiseAll": (
        "51a5c6982ba636b1397142aab7eb86e6",
        "b9886afdbeb585f0929f1fe1334dd03e",
        "d9c8370d5d4ea835b3dd7ba52feee140",
    ),
    "ConnectHub": (
        "6815c96f7df47a58c645055a2e0d9e1b",
        "636fe5e07550f026d28388e95c38a9f4",
        "cb1e85ae0c5f4b1c31221493724cc5aa",
    ),
    "Remote": (
        "d2170021bdea1c8bfca632d3d43a6993",
        "e9d79fdaee662b9f88ad5ffedb506465",
        "cb1e85ae0c5f4b1c31221493724cc5aa",
    ),
    "RemoteAll": (
        "dae39b2540424f9672db2c4f37b6394a",
        "036fdb1a9946cb6fec17ef2d907450d9",
        "cb1e85ae0c5f4b1c31221493724cc5aa",
    ),
    "RemoteGatewayInfo": (
        "21b6c2a53d6cebe0c03f90dd0c85b58d",
        "e005eaac1f4b29980f211758e562aa6e",
        "21c329af996537695f35402c601485df",
    ),
    "SetWatcherPeriod": (
        "48c82bd734fbc66058cd96447a09fe59",
        "3bfcf350fbd9f1aad223e564a8c1f0dd",
        "dbc70bcb9b617c59da49b8be04454dd5",
    ),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_has_the_sum_of_rocon(name: str) -> None:
    assert getattr(msg, name)._md5sum == MESSAGES[name]


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_has_the_sums_of_rocon(name: str) -> None:
    sums = tuple(getattr(srv, name + part)._md5sum for part in ("", "Request", "Response"))
    assert sums == SERVICES[name]


def test_the_error_codes_are_those_of_rocon() -> None:
    codes = msg.ErrorCodes
    assert (codes.SUCCESS, codes.FLIP_PATTERN_ALREDY_EXISTS, codes.REMOTE_GATEWAY_SELF_IS_NOT) == (
        0,
        23,
        52,
    )
