"""Numba kernels declared once, compiled at build, and called with their arguments checked."""
