"""Foreign things, one a module: map files, serialised messages."""
