"""What a hub and its gateways share: documents, keys, addresses, access."""
