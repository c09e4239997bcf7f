"""Occupancy grids: the value, map files, map_server and map_saver."""
