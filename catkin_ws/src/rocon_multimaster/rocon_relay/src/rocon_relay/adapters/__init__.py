"""Adapters: each module wraps one external interface."""
