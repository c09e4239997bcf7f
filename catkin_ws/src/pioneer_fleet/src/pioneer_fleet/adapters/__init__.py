"""Adapters to the outside: the registry of running fleets, recordings, the recorder."""
