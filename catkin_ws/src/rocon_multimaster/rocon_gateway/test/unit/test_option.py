import pytest

from rocon_gateway.core.code import GatewayError
from rocon_gateway.core.option import NO_OPTIONS, LinkOptions, option_rule, options_for, options_from_fields
from rocon_gateway.core.setting import GatewaySetting, SettingError


def test_a_row_asks_for_what_it_names_and_matches_the_rest():
    rule = option_rule({"name": "/tf", "tf_frames": "pioneer1/.*", "rate": 5})
    assert rule.options == LinkOptions(rate=5, tf_frames=("pioneer1/.*",))
    assert options_for([rule], "/tf", "/any", "aadi1_gateway", "me") == rule.options
    assert options_for([rule], "/tf_static", "/any", "aadi1_gateway", "me") == NO_OPTIONS


def test_the_first_row_that_means_a_connection_counts():
    rows = (
        {"name": "/image", "gateway": "base", "rate": 1},
        {"name": "/image", "node": "/camera.*", "queue_size": 2},
        {"name": "/image", "compress": True},
    )
    rules = [option_rule(row) for row in rows]
    assert options_for(rules, "/image", "/camera1", "base", "me").rate == 1
    assert options_for(rules, "/image", "/camera1", "other", "me").queue_size == 2
    assert options_for(rules, "/image", "/x", "other", "me").compress


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
        ({"name": "/tf", "tf_frames": "("}, "tf_frames"),
        ({"name": "/tf", "tf_frames": 3}, "tf_frames"),
        ({"name": "(", "rate": 1}, "name"),
        ({"name": "/tf", "rates": 1}, "rates"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_one_line_that_names_it(row, word):
    with pytest.raises(GatewayError, match=word):
        option_rule(row)
    with pytest.raises(SettingError, match=rf"^gateway: ~rule_options: .*{word}") as caught:
        GatewaySetting(rule_options=[row])
    assert "\n" not in str(caught.value)


def test_options_survive_the_way_through_a_header():
    for options in (
        NO_OPTIONS,
        LinkOptions(rate=0.5),
        LinkOptions(rate=30, queue_size=3, compress=True, tf_frames=("a|b/.*",)),
    ):
        assert options_from_fields(options.fields()) == options


@pytest.mark.parametrize(
    "fields",
    [
        {"rate": "often"},
        {"rate": "-1"},
        {"rate": "inf"},
        {"queue_size": "1.5"},
        {"compress": "lzma"},
        {"tf_frames": "("},
        {"tf_frames": "(a+)+"},
        {"tf_frames": "a*b*c*d*"},
        {"tf_frames": "x" * 300},
    ],
)
def test_what_a_stranger_asks_for_is_checked(fields):
    with pytest.raises(GatewayError):
        options_from_fields(fields)


def test_both_ends_are_satisfied_by_joined_options():
    one, other = LinkOptions(rate=5, tf_frames=("a.*",)), LinkOptions(rate=2, queue_size=4, tf_frames=(".*b",))
    joined = one.joined(other)
    assert (joined.rate, joined.queue_size, joined.compress) == (2, 4, False)
    keeps = joined.keeps_frame()
    assert [name for name in ("ab", "/a/b", "a", "b") if keeps(name)] == ["ab", "/a/b"]
    assert one.joined(NO_OPTIONS) == one
