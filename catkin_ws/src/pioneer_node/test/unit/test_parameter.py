"""A configuration error names the bad parameter and suggests the one that was probably meant."""

import math
from dataclasses import dataclass

import pytest

from pioneer_node.core.frame import resolved, stripped
from pioneer_node.core.parameter import UNKNOWN, ParameterError, config_from_mapping, value_as


@dataclass(frozen=True)
class LaserConfig:
    max_range: float = 12.0
    beams: int = 60
    frame: str = "laser"
    limit: float | None = None


def test_absent_parameters_keep_their_defaults() -> None:
    assert config_from_mapping(LaserConfig, {}, "amcl") == LaserConfig()


def test_an_integer_is_taken_where_a_float_is_wanted() -> None:
    assert config_from_mapping(LaserConfig, {"max_range": 8}, "amcl").max_range == 8.0


def test_an_optional_parameter_takes_a_value() -> None:
    assert config_from_mapping(LaserConfig, {"limit": 3}, "amcl").limit == 3.0


def test_an_unknown_parameter_is_a_warning_once_with_the_nearest_name(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for _ in range(2):
        assert config_from_mapping(LaserConfig, {"max_rnage": 8.0}, "warned") == LaserConfig()
    (record,) = caplog.records
    assert record.getMessage() == (
        "warned: unknown parameter ~max_rnage; did you mean ~max_range? It has no effect."
    )


def test_an_unknown_parameter_is_refused_where_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(UNKNOWN, "strict", True)
    with pytest.raises(
        ParameterError, match="unknown parameter ~max_rnage; did you mean ~max_range"
    ):
        config_from_mapping(LaserConfig, {"max_rnage": 8.0}, "amcl")


@pytest.mark.parametrize(
    "values", [{"beams": "few"}, {"beams": True}, {"frame": 3}, {"max_range": "far"}]
)
def test_a_value_of_the_wrong_type_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError, match="must be"):
        config_from_mapping(LaserConfig, values, "amcl")


@pytest.mark.parametrize(
    ("value", "beams", "warned"),
    [(500.0, 500, False), (1.5, 2, True), (1.2, 1, True), ("60", 60, True), ("60.0", 60, True)],
)
def test_a_whole_number_is_taken_as_roscpp_takes_it(
    value: object, beams: int, warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    assert config_from_mapping(LaserConfig, {"beams": value}, f"amcl{value}").beams == beams
    assert (f"taken as {beams}" in caplog.text) == warned


@pytest.mark.parametrize(
    ("value", "flag"), [(1, True), (0, False), ("true", True), ("False", False), (0.0, False)]
)
def test_a_flag_may_be_written_as_a_number_or_in_quotes(
    value: object, flag: bool, caplog: pytest.LogCaptureFixture
) -> None:
    assert value_as(bool, value, f"~flag{value!r}") is flag
    assert "taken as" in caplog.text


def test_a_flag_of_two_is_refused() -> None:
    with pytest.raises(ParameterError, match="must be bool, not 2"):
        value_as(bool, 2, "~flag")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused(value: float) -> None:
    with pytest.raises(ParameterError, match="~max_range must be a finite number"):
        config_from_mapping(LaserConfig, {"max_range": value}, "amcl")


def test_ignored_names_belong_to_somebody_else() -> None:
    assert (
        config_from_mapping(LaserConfig, {"costmap": {}}, "move_base", ignored={"costmap"})
        == LaserConfig()
    )


def test_frames_resolve_as_tf_does() -> None:
    assert stripped("/map") == "map"
    assert resolved("pioneer1", "odom") == "pioneer1/odom"
    assert resolved("/pioneer1/", "odom") == "pioneer1/odom"
    assert resolved("pioneer1", "/map") == "map"
    assert resolved("", "odom") == "odom"


def test_all_warnings_of_a_context_can_be_collected(caplog: pytest.LogCaptureFixture) -> None:
    with UNKNOWN.noted() as warnings:
        config_from_mapping(LaserConfig, {"beam": 3, "beams": 4.4}, "collected")
    assert warnings == [
        "collected: unknown parameter ~beam; did you mean ~beams? It has no effect.",
        "collected: parameter ~beams is 4.4, taken as 4.",
    ]
    assert not caplog.records
