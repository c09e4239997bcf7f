"""Operators' commands: validation and execution, patrols, recordings."""
