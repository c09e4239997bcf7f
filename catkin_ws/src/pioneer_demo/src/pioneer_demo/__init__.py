"""Runs a fleet on several masters with one command: start-up, live view and report."""
