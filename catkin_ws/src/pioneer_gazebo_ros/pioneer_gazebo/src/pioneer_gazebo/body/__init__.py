"""Bodies: a robot's links merged over fixed joints into rigid parts, and wheels that roll as balls."""
