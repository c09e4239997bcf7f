"""The gateway: rules as desired state, and a relay that carries the topics."""
