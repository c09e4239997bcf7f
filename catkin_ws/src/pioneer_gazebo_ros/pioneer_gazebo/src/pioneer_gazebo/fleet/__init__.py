"""Scripts that start a fleet, and the fleet's names, initial poses and maps."""
