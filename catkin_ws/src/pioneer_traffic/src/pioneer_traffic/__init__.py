"""Right of way for fleets in narrow passages."""
