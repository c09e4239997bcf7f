"""The pure core: .concert files. No processes, no terminal."""
