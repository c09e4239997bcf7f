"""The data plane: what crosses between two gateways goes through their relays and through nothing else."""
