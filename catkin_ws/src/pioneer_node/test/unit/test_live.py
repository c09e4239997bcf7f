"""Which parameters may change while a node runs, and how invalid values are handled."""

from dataclasses import dataclass
from typing import Annotated, Any

import pytest

from pioneer_node.core.live import Live, accepted, live_parameters, live_values, one_of
from pioneer_node.core.parameter import config_from_mapping


@dataclass(frozen=True)
class DriveConfig:
    speed: Annotated[float, Live(0.0, 2.0)] = 0.5
    samples: Annotated[int, Live(1)] = 20
    careful: Annotated[bool, Live()] = True
    model: Annotated[str, one_of("diff", "omni-corrected")] = "diff"
    footprint: Annotated[Any, Live()] = ""
    frame: str = "odom"


PARAMETERS = live_parameters(DriveConfig)


def test_what_is_not_marked_cannot_change() -> None:
    assert [each.name for each in PARAMETERS] == [
        "speed",
        "samples",
        "careful",
        "model",
        "footprint",
    ]
    assert accepted(PARAMETERS, {"frame": "map"}) == (
        {},
        ["no parameter frame can be changed here"],
    )


def test_marks_do_not_hinder_a_configuration_from_being_read() -> None:
    assert (
        config_from_mapping(DriveConfig, {"speed": 1, "footprint": [[0, 1]]}, "node").speed == 1.0
    )


def test_kinds_bounds_and_choices_are_those_of_dynamic_reconfigure() -> None:
    speed, samples, careful, model, footprint = PARAMETERS
    assert (speed.kind, speed.low, speed.high, speed.default) == ("double", 0.0, 2.0, 0.5)
    assert (samples.kind, samples.low, samples.high) == ("int", 1, 2**31 - 1)
    assert (careful.kind, careful.low, careful.high) == ("bool", False, True)
    assert model.choices == (("diff_const", "diff"), ("omni_corrected_const", "omni-corrected"))
    assert footprint.kind == "str"


@pytest.mark.parametrize(
    ("name", "value", "set_to"),
    [("speed", 9.0, 2.0), ("speed", -1.0, 0.0), ("samples", 0, 1), ("samples", 7, 7)],
)
def test_values_are_brought_within_their_bounds(name: str, value: float, set_to: float) -> None:
    assert accepted(PARAMETERS, {name: value}) == ({name: set_to}, [])


def test_a_value_of_another_kind_is_left_out() -> None:
    assert accepted(PARAMETERS, {"samples": 1.5}) == ({}, ["samples is of kind int, not double"])


def test_a_list_is_reported_as_text() -> None:
    assert live_values(DriveConfig(footprint=[[1.0, 0.0]]))["footprint"] == "[[1.0, 0.0]]"


def test_a_number_that_is_not_finite_changes_nothing() -> None:
    values, complaints = accepted(PARAMETERS, {"speed": float("nan"), "samples": 3})
    assert (values, complaints) == ({"samples": 3}, ["speed must be a finite number, not nan"])
