"""The measured processes, their services, and simulated worlds."""
