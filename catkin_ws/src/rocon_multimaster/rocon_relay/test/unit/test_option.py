import pytest

from rocon_relay.option import NO_OPTIONS, LinkOptions, OptionError, options_from_fields


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
        {"rate": "1e-300"},
        {"stamp_rate": "1e-300"},
        {"queue_size": "1.5"},
        {"compress": "lzma"},
        {"tf_frames": "("},
        {"tf_frames": "(?!a)b"},
        {"tf_frames": "x" * 3000},
    ],
)
def test_what_an_unauthenticated_client_asks_for_is_checked(fields):
    with pytest.raises(OptionError):
        options_from_fields(fields)


def test_both_ends_are_satisfied_by_joined_options():
    one, other = (
        LinkOptions(rate=5, tf_frames=("a.*",)),
        LinkOptions(rate=2, queue_size=4, tf_frames=(".*b",)),
    )
    joined = one.joined(other)
    assert (joined.rate, joined.queue_size, joined.compress) == (2, 4, False)
    keeps = joined.keeps_frame()
    assert [name for name in ("ab", "/a/b", "a", "b") if keeps(name)] == ["ab", "/a/b"]
    assert one.joined(NO_OPTIONS) == one
