"""Decides which programs can be started by forking a running interpreter."""

import os
from collections.abc import Collection, Mapping

# Variables that the interpreter, the linker or a library reads once, before the program starts.
_EARLY = ("PYTHON", "LD_", "LC_", "LANG", "TZ", "MALLOC_", "GLIBC_", "OMP_", "OPENBLAS_", "MKL_")


def interpreter(first_line: bytes, search: Mapping[str, str]) -> str:
    """Returns the interpreter in a script's shebang line; empty if there is none or it has arguments.

    Args:
        first_line: the script's first line.
        search: full paths of the commands that ``env`` would find.
    """
    if not first_line.startswith(b"#!"):
        return ""
    words = os.fsdecode(first_line[2:]).split()
    if len(words) == 2 and words[0] == "/usr/bin/env":
        return search.get(words[1], "")
    return words[0] if len(words) == 1 else ""


def early_differences(ours: Mapping[str, str], theirs: Mapping[str, str]) -> Collection[str]:
    """Returns the variables that would make a new interpreter behave differently from the running one."""
    names = {name for name in (*ours, *theirs) if name.startswith(_EARLY)}
    return sorted(name for name in names if ours.get(name) != theirs.get(name))
