"""The hubs: a connection to each, our state on it, and the merged view of the other gateways."""
