"""Redis as a process, and the keys in it."""
