"""Observes a fleet as a node on the hub gateway's master: robots, tracks, what a video needs."""
