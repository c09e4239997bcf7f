"""What an RViz configuration shows, and where it must be seen."""
