"""The fleet in containers: ``./pioneer up``, ``down``, ``status``, ``logs``, ``exec``. Needs Python only."""
