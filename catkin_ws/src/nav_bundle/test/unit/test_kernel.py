"""Kernels accept only the arguments that their annotations declare."""

import numpy as np
import pytest

from nav_bundle.costmap.costmap_kernel import Place, Rays, inflate, mark_points
from pioneer_kernels.declaration import KernelError

CELLS = np.zeros((4, 4), np.uint8)
PLACE = Place(0.0, 0.0, 0.1)
POINTS = np.zeros((3, 2))
TABLE = np.zeros(2, np.uint8)


@pytest.mark.parametrize(
    ("cells", "points", "words"),
    [
        (
            CELLS,
            POINTS.astype(np.int64),
            r"kernel mark_points: rays: points must be float64\[2\], .* got int64\[2\]",
        ),
        (CELLS.astype(np.int8), POINTS, r"cells must be uint8\[2\]"),
        (CELLS, np.zeros((3, 4))[:, ::2], "not contiguous"),
        (CELLS, np.zeros(6), r"got float64\[1\]"),
        (CELLS, POINTS.tolist(), "got list"),
        (np.zeros((4, 4), ">u2"), POINTS, "got >u2"),
        (CELLS, POINTS.astype(">f8"), "got >f8"),
    ],
)
def test_another_array_is_refused(cells, points, words):
    with pytest.raises(KernelError, match=words):
        mark_points(cells, PLACE, Rays(0.0, 0.0, points, 1.0))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((CELLS, (0.0, 0.0, 0.1), Rays(0.0, 0.0, POINTS, 1.0)), "place must be Place; got tuple"),
        ((CELLS, PLACE, POINTS), "rays must be Rays"),
        ((CELLS, PLACE), r"mark_points: expected 3 values \(cells, place, rays\), got 2"),
    ],
)
def test_another_group_is_refused(arguments, words):
    with pytest.raises(KernelError, match=words):
        mark_points(*arguments)


def test_a_tuple_of_another_length_is_refused():
    with pytest.raises(KernelError, match=r"inflate: window: expected 4 values"):
        inflate(CELLS, (0, 4, 0), 1, TABLE, False)
