"""The node `gateway`: parameters, services, topics, and the loop that compares and applies."""
