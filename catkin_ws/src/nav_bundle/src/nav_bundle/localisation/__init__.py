"""amcl: adaptive Monte Carlo localisation in a known map."""
