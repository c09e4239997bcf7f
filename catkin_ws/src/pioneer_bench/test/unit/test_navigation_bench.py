"""The navigation bench sums up all tours and checks each tour against the accuracy goals."""

from pioneer_bench.core.row import Row, table
from pioneer_bench.core.tour import CONDITIONS, Tour, tour_rows


def tour(**values: object) -> Tour:
    usual = {
        "condition": "scaled",
        "seed": 1,
        "waypoints": 12,
        "reached": 12,
        "seconds": 250.0,
        "wall": 125.0,
        "way": 160.0,
        "shortest": 150.0,
        "collisions": 0,
        "clearance": 0.4,
        "error_mean": 0.02,
        "error_p95": 0.05,
        "error_max": 0.08,
        "cpu": {"amcl": 0.02, "move_base": 0.06},
        "rss": {"amcl": 60.0, "move_base": 62.0},
    }
    return Tour(**{**usual, **values})


def row(rows: list[Row], what: str, unit: str = "") -> Row:
    return next(row for row in rows if row.what.endswith(what) and (not unit or row.unit == unit))


def test_one_waypoint_that_is_missed_in_any_tour_misses_the_goal() -> None:
    condition = CONDITIONS["scaled"]
    assert row(tour_rows(condition, [tour(), tour()]), "waypoints reached").holds
    missed = row(tour_rows(condition, [tour(), tour(reached=11), tour()]), "waypoints reached")
    assert (missed.samples, missed.goal, missed.holds) == ((35.0,), 36.0, False)


def test_one_collision_in_any_tour_misses_the_goal() -> None:
    rows = tour_rows(CONDITIONS["scaled"], [tour(), tour(collisions=1), tour()])
    assert row(rows, "collisions").holds is False


def test_every_tour_has_to_know_where_it_is_not_the_middle_one() -> None:
    rows = tour_rows(CONDITIONS["scaled"], [tour(), tour(), tour(error_mean=0.11)])
    assert row(rows, "error, mean").median == 0.02
    assert row(rows, "error, mean").holds is False
    assert row(rows, "error, p95").holds is True


def test_amcl_and_move_base_are_held_to_their_sum() -> None:
    rows = tour_rows(
        CONDITIONS["perfect"], [tour(cpu={"amcl": 0.1, "move_base": 0.15, "simulator": 1.0})]
    )
    both = row(rows, "both", "CPU-s/sim-s")
    assert (both.samples, both.holds) == ((0.25,), False)
    assert row(rows, "both", "MB").holds is True


def test_a_drawn_map_has_a_row_and_costs_have_no_goal() -> None:
    own = {
        "cpu": {"slam_gmapping": 0.09, "move_base": 0.3},
        "rss": {"slam_gmapping": 90.0, "move_base": 62.0},
    }
    rows = tour_rows(CONDITIONS["mapping"], [tour(map_iou=0.97, **own)])
    assert row(rows, "map IoU").samples == (0.97,)
    assert row(rows, "both", "CPU-s/sim-s").holds is None
    assert "map IoU" in table(rows)
    assert not any("IoU" in row.what for row in tour_rows(CONDITIONS["perfect"], [tour()]))
