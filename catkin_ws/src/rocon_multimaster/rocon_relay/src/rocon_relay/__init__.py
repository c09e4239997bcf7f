"""The data plane: links between gateways, and proxy nodes for remote nodes."""
