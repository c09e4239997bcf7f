"""The fleet in the browser."""
