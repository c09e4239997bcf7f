"""The robot, and pictures of what RViz shows of a fleet."""
