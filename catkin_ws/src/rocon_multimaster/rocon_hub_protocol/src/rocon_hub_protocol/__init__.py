"""The protocol between hub and gateways: documents, keys, addresses, access."""
