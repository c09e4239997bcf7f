"""Modules that moved, under the names that the documentation gave until version 1.0; kept for one release."""
