"""One foreign thing each, behind what the core defines."""
