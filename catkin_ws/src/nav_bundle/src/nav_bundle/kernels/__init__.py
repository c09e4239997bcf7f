"""Numba sources, compiled at build time into ``nav_bundle._<noun>``; only the build imports them."""
