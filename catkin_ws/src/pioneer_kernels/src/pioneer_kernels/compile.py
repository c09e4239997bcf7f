"""Compiles one kernel module into an extension that needs no numba at run time: ``python3 -m pioneer_kernels.compile``.

Every function that carries ``@kernel`` is exported with the signature that its annotations declare. Those of a module
with ``RELEASE_GIL = True`` run without Python's lock.
"""

import argparse
import importlib
import os
import sys
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_origin, get_type_hints

import numba
from numba import types
from numba.core.errors import NumbaError, NumbaPendingDeprecationWarning

# numba announces that pycc will be replaced; Debian's numba is pinned by the distribution.
warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)

from numba.pycc import CC  # noqa: E402 - the filter must precede the import that warns
from numba.pycc import compiler as pycc  # noqa: E402

from pioneer_kernels import declaration  # noqa: E402
from pioneer_kernels.declaration import KernelError  # noqa: E402

# pycc compiles numba's C helpers again for each extension, which takes as long as the kernel itself. They only unpack a
# call's arguments: -O1 compiles them in half the time of -O3 with debugging information, and calls take as long.
_HELPER_FLAGS = "-O1 -g0"

_SCALARS = {int: types.int64, float: types.float64, bool: types.boolean, type(None): types.void}


def numba_type(hint: Any) -> types.Type:
    """Returns numba's type for a parameter or result of a kernel.

    Raises:
        KernelError: the type is not supported in kernels.
    """
    if array := declaration.array_of(hint):
        return types.Array(numba.from_dtype(array[0]), array[1], "C")
    if fields := declaration.fields_of(hint):
        members = [numba_type(each) for each in fields.values()]
        return (
            types.Tuple(members) if get_origin(hint) is tuple else types.NamedTuple(members, hint)
        )
    if hint not in _SCALARS:
        raise KernelError(
            f"a kernel cannot take or return {hint}; use int, float, bool, Array1 … 3, or a NamedTuple"
        )
    return _SCALARS[hint]


def signature(function: Callable[..., Any]) -> Any:
    """Returns the numba signature that a kernel's annotations declare."""
    hints = get_type_hints(function, include_extras=True)
    return numba_type(hints.pop("return"))(*(numba_type(hint) for hint in hints.values()))


def exported(name: str) -> list[Callable[..., Any]]:
    """Imports the kernel module ``name`` and returns the functions that it exports."""
    found = defaultdict(list)

    def declare(function: Callable[..., Any]) -> Any:
        found[function.__module__].append(function)
        return numba.njit(function)

    declaration.declare, declaration.jit = declare, numba.njit
    importlib.import_module(name)
    if not found[name]:
        raise KernelError("no function carries @kernel: nothing to compile")
    return found[name]


def _flags_releasing_gil(flags: Callable[[], Any]) -> Any:
    """Returns numba's compiler flags with the flag of ``@njit(nogil=True)`` set, since pycc has no option for it."""
    changed = flags()
    changed.release_gil = True
    return changed


def main(words: Sequence[str] | None = None) -> int:
    """Compiles the module named by the words, by default of the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="pioneer_kernels.compile", description=__doc__)
    parser.add_argument(
        "--source-root", type=Path, required=True, help="folder that holds the package"
    )
    parser.add_argument("--module", required=True, help="dotted name of the kernel module")
    parser.add_argument("--extension", required=True, help="name of the extension to write")
    parser.add_argument(
        "--output", type=Path, required=True, help="folder the extension is written to"
    )
    parser.add_argument("--cpu", default="host", help="LLVM processor name (default: %(default)s)")
    arguments = parser.parse_args(words)
    sys.path.insert(0, str(arguments.source_root))
    # Otherwise importing the kernel writes __pycache__ into the source tree, owned by the build's user.
    sys.dont_write_bytecode = True
    os.environ["CFLAGS"] = f"{os.environ.get('CFLAGS', '')} {_HELPER_FLAGS}".strip()
    try:
        functions = exported(arguments.module)
        if getattr(sys.modules[arguments.module], "RELEASE_GIL", False):
            pycc.Flags = partial(_flags_releasing_gil, pycc.Flags)
        compiler = CC(arguments.extension, source_module=arguments.module)
        compiler.output_dir, compiler.target_cpu = str(arguments.output), arguments.cpu
        for function in functions:
            compiler.export(function.__name__, signature(function))(function)
        compiler.compile()
    except (KernelError, NumbaError) as error:
        print(f"pioneer_kernels.compile: {arguments.module}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
