"""Nodes and commands: report, replay, teleop."""
