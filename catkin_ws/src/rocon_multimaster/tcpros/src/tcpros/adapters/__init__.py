"""One foreign thing each."""
