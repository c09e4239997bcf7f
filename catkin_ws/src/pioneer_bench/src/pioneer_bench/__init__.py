"""Measures the running system and compares the figures with their goals."""
