"""RViz and its virtual display."""
