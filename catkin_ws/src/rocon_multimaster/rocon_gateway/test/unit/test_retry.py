"""When gateways retry to connect to a hub."""

from rocon_gateway.hub.client import RETRY, retry_pause


def test_gateways_of_a_fleet_do_not_come_back_to_their_hub_in_step() -> None:
    pauses = [retry_pause() for _ in range(1000)]
    for tenth in range(10):
        begin = RETRY * (0.5 + tenth / 10)
        assert 50 < sum(begin <= pause < begin + RETRY / 10 for pause in pauses) < 200
    assert abs(sum(pauses) / len(pauses) - RETRY) < RETRY / 10
