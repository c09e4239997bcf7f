"""Layered costmaps as costmap_2d's, the robot's footprint, and the sensors' topics."""
