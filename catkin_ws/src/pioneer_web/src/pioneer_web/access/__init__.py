"""Who may look and who may drive: tokens, sessions, origins, limits for unknown clients."""
