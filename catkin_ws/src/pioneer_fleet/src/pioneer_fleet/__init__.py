"""How one computer of the fleet does."""
