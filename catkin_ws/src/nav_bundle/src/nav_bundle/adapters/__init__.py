"""Adapters to files and wire formats, one per module: map files, serialised messages."""
