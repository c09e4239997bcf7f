"""The scripts, each a function."""
