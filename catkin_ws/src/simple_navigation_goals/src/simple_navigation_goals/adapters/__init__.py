"""Adapters, one per module: the move_base action, files of waypoints."""
