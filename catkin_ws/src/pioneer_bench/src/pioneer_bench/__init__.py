"""Measurements of the running parts, beside the figures they are to reach."""
