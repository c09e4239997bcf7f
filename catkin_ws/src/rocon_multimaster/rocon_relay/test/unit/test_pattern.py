"""Patterns match in linear time; those that cannot are refused."""

import time

import pytest

from rocon_relay import pattern
from rocon_relay.pattern import PatternError, check_pattern, compiled, matches_whole


@pytest.mark.parametrize(
    "pattern", [r"/(\w+/?)+/odom", "(a+)+b", "(.*)*x", ".*.*.*.*.*=", "(a|a)*b", "(/?a?){50}b"]
)
def test_no_pattern_takes_long_for_a_name_of_any_length(pattern):
    """With a name of 40 characters, the first of these once stalled its gateway, which then ignored even SIGTERM."""
    began = time.process_time()
    assert not matches_whole(pattern, "/" + "a" * 100_000)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize(
    "pattern",
    ["(", r"(a)\1", "(?=a)b", "(?!a)b", "(?<!a)b", "(?>a)", "a*+", "a{2000}", "x" * 2000, "\udcff"],
)
def test_a_pattern_that_is_none_or_has_no_linear_time_is_refused(pattern):
    with pytest.raises(PatternError):
        compiled(pattern)


def test_patterns_match_whole_names_as_rocon_has_it():
    assert matches_whole("/pioneer[0-9]+/(odom|tf)", "/pioneer12/odom")
    assert not matches_whole("/pioneer[0-9]+", "/pioneer12/odom")
    assert matches_whole(".*scan.*", "/pioneer1/scan_filtered")
    assert not matches_whole(".*", "\udcff")
    assert not matches_whole(".*", "\udcff\U0001f600")


def test_a_plain_name_matches_only_itself_and_is_not_compiled():
    compiled.cache_clear()
    assert matches_whole("/pioneer1/odom", "/pioneer1/odom")
    assert not matches_whole("/pioneer1/odom", "/pioneer1/odom2")
    check_pattern("/pioneer1/odom")
    assert compiled.cache_info().currsize == 0


def test_long_names_are_matched_but_not_kept():
    """A client of a ROS master may register names of a megabyte, thousands of them."""
    pattern._remembered_match.cache_clear()
    assert matches_whole("/a+", "/" + "a" * 1_000_000)
    assert not matches_whole("/a+", "/" + "b" * 1_000_000)
    assert pattern._remembered_match.cache_info().currsize == 0


def test_a_long_plain_pattern_is_refused():
    with pytest.raises(PatternError):
        check_pattern("x" * 2000)
