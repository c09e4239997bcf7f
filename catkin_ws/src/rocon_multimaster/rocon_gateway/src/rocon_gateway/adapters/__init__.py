"""Adapters: each module wraps one external interface that the core needs."""
