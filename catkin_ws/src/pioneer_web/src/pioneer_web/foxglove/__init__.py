"""Foxglove's WebSocket protocol over raw messages."""
