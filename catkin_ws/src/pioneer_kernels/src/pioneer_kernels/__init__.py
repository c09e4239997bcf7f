"""Numba kernels: declared once, compiled at build time, and called with checked arguments."""
