"""Numba sources, compiled at build into ``nav_bundle._<noun>``; imported by the build alone."""
