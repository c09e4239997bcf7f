"""The map in which planning is measured."""

import numpy as np
import pytest
from scipy.ndimage import label

from pioneer_bench.nav_kernel import room_cells


@pytest.mark.parametrize("side", [400, 1000])
def test_every_free_cell_can_be_reached_from_every_other(side: int) -> None:
    assert label(room_cells(side) == 0)[1] == 1


def test_one_seed_gives_one_map() -> None:
    assert np.array_equal(room_cells(400, 7), room_cells(400, 7))
    assert not np.array_equal(room_cells(400, 7), room_cells(400, 8))
