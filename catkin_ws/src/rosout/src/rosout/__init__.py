"""Collects the log messages of all nodes."""
