"""Sensors of the simulated robots."""
