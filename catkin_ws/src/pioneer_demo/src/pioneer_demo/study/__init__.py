"""Studies: many runs of variants of a scenario, their statistics and report."""
