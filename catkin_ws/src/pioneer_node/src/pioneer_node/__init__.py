"""What every node of this workspace shares: parameters, frames, entry point."""
