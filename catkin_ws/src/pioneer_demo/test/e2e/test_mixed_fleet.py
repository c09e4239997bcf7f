"""A fleet of different robots reaches its waypoints."""

import json
from pathlib import Path

import rospkg

WHOLE = 300.0


def test_a_pioneer_and_a_rover_reach_their_waypoints(start, tmp_path):
    package = Path(rospkg.RosPack().get_path("pioneer_description"))
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text(
        "robots:\n"
        "  - {}\n"
        f"  - {{name: rover, description: {package}/urdf/rover.xacro, laser: scan,\n"
        "     navigation: package://pioneer_2dnav/config/rover_params.yaml}\n"
    )
    demo = start("--fleet", fleet, "--world", "small_world", "--waypoints", 1)
    assert demo.process.wait(WHOLE) == 0, demo.text()
    assert demo.processes() == {}
    robots = json.loads((demo.report / "report.json").read_text())["robots"]
    assert {name: robot["reached"] for name, robot in robots.items()} == {"pioneer1": 1, "rover": 1}
    assert robots["rover"]["localisation_error"]["p95"] <= 0.2
