"""Adapters, one external dependency per module: file formats, the engine, the workspace's packages."""
