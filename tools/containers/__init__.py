"""The fleet in containers: ``./pioneer up``, ``down``, ``status``, ``logs``, ``exec``. Needs only Python."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
SOURCE = ROOT / "catkin_ws" / "src"
# Imported from the sources: this machine needs no built workspace.
for _package in ("pioneer_demo", "pioneer_fleet", "pioneer_harness", "pioneer_node", "tcpros"):
    sys.path.append(str(SOURCE / _package / "src"))
