"""Waypoint clients and the spin recovery."""
