"""Adds this folder to the import path."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from identity import identities  # noqa: F401 - a fixture
