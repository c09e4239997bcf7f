"""Runs of a fleet: until Ctrl-C, as a demo with waypoints, in lockstep, with faults."""
