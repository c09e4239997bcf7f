"""The content of an RViz configuration, and where in the image it must be visible."""
