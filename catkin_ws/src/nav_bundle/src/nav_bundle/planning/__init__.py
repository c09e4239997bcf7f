"""Global planners (navfn, GlobalPlanner), and which plan the robot follows."""
