"""Kernels take the arrays their signatures name, and no others."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from nav_bundle.core import kernel
from nav_bundle.core.kernel import KernelError

SOURCES = Path(kernel.__file__).parents[1] / "kernels"


def signatures():
    """Yields (name, signature) of every kernel of the modules bound, from their sources: numba is for the build."""
    for source in sorted(path for path in SOURCES.glob("*.py") if hasattr(kernel, f"_{path.stem}")):
        for statement in ast.parse(source.read_text()).body:
            if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "SIGNATURES":
                yield from ast.literal_eval(statement.value).items()


def arrays(signature):
    """Returns the array arguments of a numba signature as ``f8[2]``; numba's two ways of naming types are one."""
    for kind, size, axes in re.findall(r"\b([a-z]+)(\d+)\[([^]]*)\]", signature):
        assert axes.endswith("::1"), f"{signature}: an array that is not C-contiguous"
        length = int(size) if len(kind) == 1 else int(size) // 8
        yield f"{kind[0]}{length}[{axes.count(',') + 1}]"


@pytest.mark.parametrize(("name", "signature"), signatures())
def test_the_boundary_is_what_the_kernel_was_compiled_for(name, signature):
    bound = getattr(kernel, name, None)
    assert bound is not None, f"core/kernel.py does not bind {name}"
    assert list(bound.array_types) == list(arrays(signature))


CELLS = np.zeros((4, 4), np.uint8)
POINTS = np.zeros((3, 2))


@pytest.mark.parametrize(
    ("cells", "points", "words"),
    [
        (CELLS, POINTS.astype(np.int64), r"mark_points: array 2 must be f8\[2\], contiguous, not i8\[2\]"),
        (CELLS.astype(np.int8), POINTS, r"array 1 must be u1\[2\]"),
        (CELLS, np.zeros((3, 4))[:, ::2], "not contiguous"),
        (CELLS, np.zeros(6), r"not f8\[1\]"),
        (CELLS, POINTS.tolist(), "takes 2 arrays, not 1"),
        (np.zeros((4, 4), ">u2"), POINTS, r"not u2\[2\]"),
    ],
)
def test_another_array_is_refused(cells, points, words):
    with pytest.raises(KernelError, match=words):
        kernel.mark_points(cells, 0.0, 0.0, 0.1, 0.0, 0.0, points, 1.0)


def test_big_endian_numbers_are_refused():
    with pytest.raises(KernelError):
        kernel.mark_points(CELLS, 0.0, 0.0, 0.1, 0.0, 0.0, POINTS.astype(">f8"), 1.0)
