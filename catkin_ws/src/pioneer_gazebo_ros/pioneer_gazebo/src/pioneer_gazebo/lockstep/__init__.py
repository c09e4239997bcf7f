"""Lockstep: simulated time waits until every node is done with a period."""
