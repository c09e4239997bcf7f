"""The scripts' entry points."""
