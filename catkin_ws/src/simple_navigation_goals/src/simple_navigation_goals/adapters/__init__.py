"""Adapters, one per module: the move_base action, patrol and queue files."""
