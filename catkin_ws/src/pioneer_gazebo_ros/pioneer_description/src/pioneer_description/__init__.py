"""The robot model, and images of a fleet in RViz."""
