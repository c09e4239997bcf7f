"""The report as a node."""
