"""Adds this folder and the certificates of tcpros' tests to the import path."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[3] / "tcpros/test/unit")]
from identity import identities  # noqa: E402, F401 - a fixture
