"""Foreign things, one a module: the move_base action."""
