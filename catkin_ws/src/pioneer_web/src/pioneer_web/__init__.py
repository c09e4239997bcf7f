"""Web dashboard of the fleet."""
