"""Adapters: the Redis process, its keys, the hub's port and mDNS."""
