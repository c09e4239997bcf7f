"""Planar laser: ray casts against walls and moving outlines, ranges and noise."""
