"""Drives a robot by keyboard."""
