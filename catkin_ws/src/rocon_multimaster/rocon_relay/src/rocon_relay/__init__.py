"""The data plane: links between gateways, and nodes that stand for far ones."""
