"""What a .concert file means: no process, no terminal."""
