"""move_base: goals, the state machine, recovery behaviours, and the node that runs them."""
