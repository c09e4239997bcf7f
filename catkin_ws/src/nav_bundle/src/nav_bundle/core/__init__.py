"""Former places of the modules that a planner of one's own imports; each warns. They go with the next release."""
