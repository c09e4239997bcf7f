"""Adapters to the outside: map files, world folders, terminal, pictures, fleet processes, networks."""
