"""Layered costmaps with costmap_2d's costs: static map, obstacles seen by sensors, inflation."""
