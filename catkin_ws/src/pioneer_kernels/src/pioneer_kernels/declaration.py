"""Declares kernels: the annotations of a kernel function define its interface.

At build time, ``compile.py`` derives numba signatures from them. At run time a kernel module is imported without numba,
and ``@kernel`` replaces each function by its compiled form. That form rejects arguments that do not match the
annotations, because the extension itself checks nothing: it would read an int64 array as float64, and a tuple of the
wrong length beyond its end.

A parameter is one of

* ``int``, ``float``, ``bool``;
* ``Array1[np.float64]``, ``Array2[…]``, ``Array3[…]``: a C-contiguous array of that type and number of dimensions;
* a group of these: a ``NamedTuple``, or ``tuple[int, int]`` and the like.

A kernel returns ``int``, ``float``, ``bool`` or ``None``. Lengths of arrays are not checked.
"""

import importlib
from collections.abc import Callable
from typing import Annotated, Any, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy import ndarray
from numpy.typing import NDArray

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
Item = TypeVar("Item", bound=np.generic)

Array1 = Annotated[NDArray[Item], 1]
Array2 = Annotated[NDArray[Item], 2]
Array3 = Annotated[NDArray[Item], 3]

declare: Callable[[Callable[..., Any]], Any] | None = None
"""Receives every kernel while kernels are compiled; None at run time."""
jit: Callable[..., Any] | None = None
"""``numba.njit`` while kernels are compiled; None at run time."""


class KernelError(Exception):
    """A kernel declaration that numba cannot compile, or arguments that do not match it."""


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Marks a helper function that kernels call; ``options`` are those of ``numba.njit``."""
    if jit:
        return jit(function, **options)
    return function or (lambda marked: marked)


def kernel(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Returns the compiled form of a kernel, which takes positional arguments and checks them.

    Raises:
        KernelError: by the returned function, if an array, a group or the number of arguments was not declared so.
    """
    if declare:
        return declare(function)
    package, *_, module = function.__module__.split(".")
    noun = module.removesuffix("_kernel")
    compiled = getattr(importlib.import_module(f"{package}._{noun}"), function.__name__)
    hints = get_type_hints(function, include_extras=True)
    del hints["return"]
    return checked(compiled, function.__name__, hints)


def array_of(hint: Any) -> tuple[np.dtype[Any], int] | None:
    """Returns the dtype and number of dimensions of ``Array1[…]`` to ``Array3[…]``; None for other hints."""
    if get_origin(hint) is not Annotated:
        return None
    array, dimensions = get_args(hint)
    return np.dtype(get_args(get_args(array)[1])[0]), dimensions


def fields_of(hint: Any) -> dict[str, Any] | None:
    """Returns the hints of a group's fields by name; None if ``hint`` is not a group."""
    if get_origin(hint) is tuple:
        return {str(index): each for index, each in enumerate(get_args(hint))}
    return (
        get_type_hints(hint, include_extras=True)
        if isinstance(hint, type) and issubclass(hint, tuple)
        else None
    )


def checked(
    compiled: Callable[..., Result], name: str, hints: dict[str, Any]
) -> Callable[..., Result]:
    """Returns ``compiled`` with its arguments checked against the ``hints`` of its parameters."""
    arrays, groups = _checks(hints)
    count = len(hints)

    def call(*arguments: Any) -> Result:
        if len(arguments) != count or not _match(arguments, arrays, groups):
            raise KernelError(f"kernel {name}: {_complaint(arguments, hints)}")
        return compiled(*arguments)

    return call


_Arrays = list[tuple[int, np.dtype[Any], int]]
_Groups = list[tuple[int, type[tuple[Any, ...]], int, _Arrays, "_Groups"]]  # type: ignore[misc]


def _checks(hints: dict[str, Any]) -> tuple[_Arrays, _Groups]:
    """Returns (position, dtype, dimensions) of the arrays, and (position, type, length, inner checks) of the groups."""
    arrays, groups = [], []
    for index, hint in enumerate(hints.values()):
        if array := array_of(hint):
            arrays.append((index, *array))
        elif fields := fields_of(hint):
            groups.append((index, get_origin(hint) or hint, len(fields), *_checks(fields)))
    return arrays, groups


def _match(values: tuple[Any, ...], arrays: _Arrays, groups: _Groups) -> bool:
    for index, dtype, dimensions in arrays:
        array = values[index]
        if not (
            isinstance(array, ndarray)
            and array.ndim == dimensions
            and (array.dtype is dtype or array.dtype == dtype)
            and array.flags.c_contiguous
        ):
            return False
    for index, kind, length, inner_arrays, inner_groups in groups:
        group = values[index]
        if not isinstance(group, kind) or len(group) != length:
            return False
        if (inner_arrays or inner_groups) and not _match(group, inner_arrays, inner_groups):
            return False
    return True


def _complaint(values: tuple[Any, ...], hints: dict[str, Any], group: str = "") -> str:
    """Returns a message that names the first value that does not match its hint."""
    if len(values) != len(hints):
        return f"{group}expected {len(hints)} values ({', '.join(hints)}), got {len(values)}"
    for (name, hint), value in zip(hints.items(), values, strict=True):
        if _match((value,), *_checks({name: hint})):
            continue
        if array := array_of(hint):
            wanted = f"{array[0]}[{array[1]}], C-contiguous"
        elif isinstance(value, get_origin(hint) or hint):
            return _complaint(value, fields_of(hint) or {}, f"{group}{name}: ")
        else:
            wanted = (get_origin(hint) or hint).__name__
        return f"{group}{name} must be {wanted}; got {_described(value)}"
    raise AssertionError("every value matches")


def _described(value: Any) -> str:
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    return f"{value.dtype}[{value.ndim}]{'' if value.flags.c_contiguous else ', not contiguous'}"
