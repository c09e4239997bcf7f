"""The hub: a supervised Redis server where gateways meet."""
