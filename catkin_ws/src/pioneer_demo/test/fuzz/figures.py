"""Figures that a fuzzer's process tells while it runs, as lines of JSON in its output."""

import json
import sys
from collections.abc import Mapping
from typing import Any


def tell(figures: Mapping[str, Any]) -> None:
    """Writes figures as one line, at once.

    One call of ``write``: where Python's output is unbuffered, ``print`` makes two, one for the line and one for its
    end, and what another thread logs to the same file came in between.
    """
    sys.stdout.write(json.dumps(figures) + "\n")
    sys.stdout.flush()
