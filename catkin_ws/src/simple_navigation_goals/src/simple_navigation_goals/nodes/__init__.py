"""The nodes: waypoint clients and spin recovery."""
