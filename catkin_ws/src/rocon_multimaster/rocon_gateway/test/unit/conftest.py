"""Adds this folder and the relay's test helpers to the import path."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "rocon_relay/test/unit")]
