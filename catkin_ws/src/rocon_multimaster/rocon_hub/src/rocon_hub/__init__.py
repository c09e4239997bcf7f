"""The hub: a supervised Redis server through which gateways find each other."""
