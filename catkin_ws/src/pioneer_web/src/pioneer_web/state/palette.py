"""The robots' colours, the same as in RViz."""

import yaml

from pioneer_description.core.fleet_view import turned
from pioneer_description.nodes.rviz_snapshot import TEMPLATE

_HUE_STEP = 0.065
"""Turn of the hue each time the template's colours are used again."""


def colours(count: int) -> list[str]:
    """Returns the colours of the first ``count`` robots, as ``rgb(r, g, b)``."""
    scans = _scan_colours()
    found = []
    for number in range(count):
        use, index = divmod(number, len(scans))
        colour = turned(scans[index], _HUE_STEP * use)
        found.append(f"rgb({colour.replace(';', ',')})")
    return found


def _scan_colours() -> list[str]:
    """Returns the colours of the robots' scans in RViz's configuration."""
    displays = yaml.safe_load(TEMPLATE.read_text())["Visualization Manager"]["Displays"]
    groups = [display["Displays"] for display in displays if "Displays" in display]
    return [
        next(display["Color"] for display in group if display["Name"] == "Scan") for group in groups
    ]
