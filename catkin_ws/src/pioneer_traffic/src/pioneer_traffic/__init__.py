"""Right of way for fleets in narrow ways."""
