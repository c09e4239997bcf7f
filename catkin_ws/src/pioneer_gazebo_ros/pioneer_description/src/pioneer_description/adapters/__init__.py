"""RViz and a screen that nobody sees."""
