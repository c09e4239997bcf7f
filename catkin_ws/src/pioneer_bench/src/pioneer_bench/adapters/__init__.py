"""Processes and services of what is measured."""
