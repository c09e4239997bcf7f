"""Lets the tests import what stands beside them, and what the relay's tests make up."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[2] / "rocon_relay/test/unit")]
