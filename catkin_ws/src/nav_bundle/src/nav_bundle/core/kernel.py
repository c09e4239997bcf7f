"""The compiled kernels behind a typed boundary.

Extensions that numba compiles ahead of time take an int64 array for a float64 one and every second
column for the whole row: wrong results, or memory that is not theirs. Here each is bound to the types
its signature names, and refuses others. A check costs 0.4 µs an array. Lengths are not checked.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from nav_bundle import (
    _alignment,
    _costmap,
    _dynamic_window,
    _likelihood,
    _navfn,
    _particle,
    _plan_distance,
    _slam,
    _trajectory,
)
from nav_bundle.core.error import NavigationError

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


class KernelError(NavigationError):
    """An array of another type, number of dimensions or layout than a kernel takes."""


def checked(kernel: Callable[Parameters, Result], *types: str) -> Callable[Parameters, Result]:
    """Returns ``kernel`` with its arrays checked.

    Args:
        kernel: an exported function, called with positional arguments.
        types: of its arrays in their order: dtype and number of dimensions, such as ``f8[2]``; all C-contiguous.
            They stand in ``array_types`` of what is returned.

    Raises:
        KernelError: by the returned function, for an array that is not of its type.
    """
    wanted = [(np.dtype(name[: name.index("[")]), int(name[-2])) for name in types]

    def call(*arguments: Parameters.args, **_: Parameters.kwargs) -> Result:
        index = 0
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                if index < len(wanted):
                    dtype, dimensions = wanted[index]
                    if argument.dtype == dtype and argument.ndim == dimensions and argument.flags.c_contiguous:
                        index += 1
                        continue
                raise KernelError(_complaint(kernel, index, types, argument))
        if index != len(wanted):
            raise KernelError(f"kernel {kernel.__name__} takes {len(wanted)} arrays, not {index}")
        return kernel(*arguments)

    call.array_types = types  # type: ignore[attr-defined]
    return call


def _complaint(kernel: Callable[..., object], index: int, types: tuple[str, ...], given: object) -> str:
    assert isinstance(given, np.ndarray)
    wanted = types[index] if index < len(types) else "no more"
    layout = "contiguous" if given.flags.c_contiguous else "not contiguous"
    kind = f"{given.dtype.str[1:]}[{given.ndim}]"
    return f"kernel {kernel.__name__}: array {index + 1} must be {wanted}, contiguous, not {kind}, {layout}"


clear_rays = checked(_costmap.clear_rays, "u1[2]", "f8[2]")
mark_points = checked(_costmap.mark_points, "u1[2]", "f8[2]")
fill_polygon = checked(_costmap.fill_polygon, "u1[2]", "f8[2]")
merge_highest = checked(_costmap.merge_highest, "u1[2]", "u1[2]")
merge_known = checked(_costmap.merge_known, "u1[2]", "u1[2]")
changed_window = checked(_costmap.changed_window, "u1[2]", "u1[2]", "i8[1]")
inflate = checked(_costmap.inflate, "u1[2]", "u1[1]")

begin = checked(_navfn.begin, "f4[2]", "u1[2]", "u1[2]", "f4[1]", "i4[2]", "i8[1]", "f8[1]")
spread = checked(_navfn.spread, "f4[2]", "u1[2]", "u1[2]", "f4[1]", "i4[2]", "i8[1]", "f8[1]", "f4[2]")
coarsen = checked(_navfn.coarsen, "u1[2]", "f4[1]", "u1[2]")
descend = checked(_navfn.descend, "f4[2]", "f8[2]")
nearest_reached = checked(_navfn.nearest_reached, "f4[2]")

distance_grids = checked(_plan_distance.distance_grids, "u1[2]", "f8[2]", "f8[2]", "i4[2]", "i4[2]", "i4[1]")
goal_grid = checked(_plan_distance.goal_grid, "u1[2]", "f8[2]", "f8[2]", "i4[2]", "i4[1]")
footprint_cost = checked(_trajectory.footprint_cost, "u1[2]", "f8[2]")
search = checked(
    _trajectory.search,
    *("u1[2]", "i4[2]", "i4[2]", "f8[2]", "f8[1]", "f8[1]", "f8[1]", "f8[2]", "f8[1]", "f8[1]", "f8[2]", "f8[2]"),
)
roll_out = checked(_trajectory.roll_out, "f8[1]", "f8[1]", "f8[1]", "f8[1]", "f8[1]", "f8[2]")

score = checked(
    _dynamic_window.score,
    *("u1[2]", "i4[2]", "i4[2]", "i4[2]", "f8[2]", "f8[1]", "f8[1]", "f8[1]", "f8[2]", "f8[1]", "f8[1]", "f8[2]"),
)
trace = checked(_dynamic_window.trace, "f8[1]", "f8[1]", "f8[1]", "f8[1]", "f8[1]", "f8[2]")

resample = checked(_particle.resample, "f8[2]", "f8[1]", "f8[1]", "u1[1]", "f8[2]", "i8[1]", "f8[2]")
find_cells = checked(_particle.find_cells, "i1[2]", "i8[1]", "i8[1]", "i8[2]")
cluster = checked(_particle.cluster, "f8[2]", "f8[1]", "i8[1]", "i8[1]", "f8[2]")

distance_field = checked(_likelihood.distance_field, "i1[2]", "u2[2]")
add_likelihoods = checked(_likelihood.add_likelihoods, "f8[2]", "f8[2]", "u2[2]", "f8[1]", "f8[1]", "f8[1]")
count_agreement = checked(_likelihood.count_agreement, "f8[2]", "f8[2]", "u2[2]", "f8[1]", "i8[1]")
expected_ranges = checked(_likelihood.expected_ranges, "f8[2]", "f8[1]", "f8[1]", "i1[2]", "f8[1]", "f8[2]")

align = checked(_alignment.align, "f8[1]", "f8[2]", "u2[2]", "f8[1]", "f8[2]", "f8[1]")

match = checked(_slam.match, "f8[2]", "f8[2]", "i4[3]", "u2[3]", "f8[1]", "f8[1]", "f8[2]")
register = checked(_slam.register, "f8[1]", "f8[2]", "u1[1]", "f8[1]", "i4[2]", "u2[3]", "i4[1]", "i4[1]")
draw = checked(_slam.draw, "i4[2]", "u2[3]", "i1[2]")
