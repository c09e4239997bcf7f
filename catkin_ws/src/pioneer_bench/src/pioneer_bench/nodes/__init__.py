"""Nodes and processes that generate load and measure it."""
