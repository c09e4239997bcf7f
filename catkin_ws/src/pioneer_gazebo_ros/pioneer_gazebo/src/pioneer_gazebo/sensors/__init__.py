"""Sensors besides lasers: motion of links, cameras, and what a Pioneer's driver reports."""
