"""Compiles one kernel module into an extension that needs no numba at run time.

A kernel module is ordinary numba source. Its ``SIGNATURES`` maps each exported function's name to
a numba signature; functions that exported ones call carry ``@njit``. With ``RELEASE_GIL = True`` the
exported functions run without Python's lock. The module itself is imported here, at build, and nowhere
else: import-linter forbids it elsewhere.
"""

import argparse
import importlib
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core.errors import NumbaError, NumbaPendingDeprecationWarning

# numba announces that pycc will be replaced; Debian's numba is pinned by the distribution.
warnings.simplefilter("ignore", NumbaPendingDeprecationWarning)

from numba.pycc import CC  # noqa: E402 - the filter has to stand before the import that warns
from numba.pycc import compiler as pycc  # noqa: E402


class KernelError(Exception):
    """A kernel module that does not say what to compile."""


def compiler_for(module: ModuleType, extension: str, output: Path, cpu: str) -> CC:
    """Returns a compiler loaded with every function that ``module.SIGNATURES`` exports."""
    signatures = getattr(module, "SIGNATURES", None)
    if not signatures:
        raise KernelError(f"{module.__name__}: no SIGNATURES, nothing to compile")
    if getattr(module, "RELEASE_GIL", False):
        pycc.Flags = partial(_flags_releasing_gil, pycc.Flags)
    compiler = CC(extension, source_module=module)
    compiler.output_dir = str(output)
    compiler.target_cpu = cpu
    for name, signature in signatures.items():
        function = getattr(module, name, None)
        if function is None:
            raise KernelError(f"{module.__name__}: SIGNATURES names {name}, which is not defined")
        compiler.export(name, signature)(getattr(function, "py_func", function))
    return compiler


def _flags_releasing_gil(flags: Callable[[], Any]) -> Any:
    """Returns numba's compiler flags with the one set that ``@njit(nogil=True)`` sets: pycc has no option for it."""
    changed = flags()
    changed.release_gil = True
    return changed


def main() -> int:
    """Compiles the module named on the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source-root", type=Path, required=True, help="folder that holds the package")
    parser.add_argument("--module", required=True, help="dotted name of the kernel module")
    parser.add_argument("--extension", required=True, help="name of the extension to write")
    parser.add_argument("--output", type=Path, required=True, help="folder the extension is written to")
    parser.add_argument("--cpu", default="host", help="LLVM processor name (default: %(default)s)")
    arguments = parser.parse_args()
    sys.path.insert(0, str(arguments.source_root))
    # Without this, importing the kernel writes __pycache__ into the source tree as the build's user.
    sys.dont_write_bytecode = True
    module = importlib.import_module(arguments.module)
    try:
        compiler_for(module, arguments.extension, arguments.output, arguments.cpu).compile()
    except (KernelError, NumbaError) as error:
        print(f"compile_kernel: {arguments.module}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
