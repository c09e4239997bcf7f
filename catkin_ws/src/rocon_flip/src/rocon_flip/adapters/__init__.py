"""The local gateway, as a client sees it."""
