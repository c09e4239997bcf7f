"""Shared basis of all nodes in this workspace: parameters, frames, entry point."""
