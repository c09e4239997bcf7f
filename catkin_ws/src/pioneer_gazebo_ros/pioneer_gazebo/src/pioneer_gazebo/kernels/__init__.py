"""Numba source of the package's compiled extensions; imported at build only."""
