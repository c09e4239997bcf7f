import pytest

from rocon_gateway.error import ConfigError, GatewayError
from rocon_gateway.node.config import GatewayConfig
from rocon_gateway.rules.option_rule import option_rule, rule_for
from rocon_relay.option import NO_OPTIONS, LinkOptions, OptionError


def test_a_row_asks_for_what_it_names_and_matches_the_rest():
    rule = option_rule({"name": "/tf", "tf_frames": "pioneer1/.*", "rate": 5})
    assert rule.options == LinkOptions(rate=5, tf_frames=("pioneer1/.*",))
    assert rule_for([rule], "/tf", "/any", "aadi1_gateway", "me") is rule
    assert rule_for([rule], "/tf_static", "/any", "aadi1_gateway", "me").options == NO_OPTIONS


def test_the_first_row_that_means_a_connection_counts():
    rows = (
        {"name": "/image", "gateway": "base", "rate": 1},
        {"name": "/image", "node": "/camera.*", "queue_size": 2},
        {"name": "/image", "compress": True},
    )
    rules = [option_rule(row) for row in rows]
    assert rule_for(rules, "/image", "/camera1", "base", "me").options.rate == 1
    assert rule_for(rules, "/image", "/camera1", "other", "me").options.queue_size == 2
    assert rule_for(rules, "/image", "/x", "other", "me").options.compress


@pytest.mark.parametrize(
    ("row", "word"),
    [
        ("/tf", "mapping"),
        ({"name": "/tf"}, "nothing"),
        ({"name": "/tf", "rate": 0}, "rate"),
        ({"name": "/tf", "rate": -1.5}, "rate"),
        ({"name": "/tf", "rate": "fast"}, "rate"),
        ({"name": "/tf", "rate": True}, "rate"),
        ({"name": "/tf", "rate": float("nan")}, "rate"),
        ({"name": "/tf", "queue_size": 1.5}, "queue_size"),
        ({"name": "/tf", "compress": "yes"}, "compress"),
        ({"name": "/tf", "foreign_nodes": 0}, "foreign_nodes"),
        ({"name": "/tf", "foreign_nodes": True}, "nothing"),
        ({"name": "/tf", "tf_frames": "("}, "tf_frames"),
        ({"name": "/tf", "tf_frames": 3}, "tf_frames"),
        ({"name": "(", "rate": 1}, "name"),
        ({"name": "/tf", "rates": 1}, "rates"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_one_line_that_names_it(row, word):
    with pytest.raises((GatewayError, OptionError), match=word):
        option_rule(row)
    with pytest.raises(ConfigError, match=rf"^gateway: ~rule_options: .*{word}") as caught:
        GatewayConfig(rule_options=[row])
    assert "\n" not in str(caught.value)
