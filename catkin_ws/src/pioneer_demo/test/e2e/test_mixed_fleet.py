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


def test_robots_of_another_make_drive_beside_a_pioneer_with_no_more_than_their_description(
    start, tmp_path
):
    """Two of one make, whose topics are absolute, whose root is base_footprint and whose laser is /scan."""
    package = Path(rospkg.RosPack().get_path("pioneer_gazebo"))
    description = package / "test" / "unit" / "burger_like.urdf"
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text(
        "robots:\n  - {}\n"
        + "".join(
            f"  - {{name: burger{number}, description: {description}}}\n" for number in (1, 2)
        )
    )
    demo = start("--fleet", fleet, "--world", "small_world", "--waypoints", 1)
    assert demo.process.wait(WHOLE) == 0, demo.text()
    robots = json.loads((demo.report / "report.json").read_text())["robots"]
    assert {name: robot["reached"] for name, robot in robots.items()} == {
        "pioneer1": 1,
        "burger1": 1,
        "burger2": 1,
    }
    for robot in robots.values():
        assert robot["localisation_error"]["p95"] <= 0.2
    assert "Right of way is off" not in demo.text()
    assert (demo.report / "log" / "navigation-of-burger1.log").read_text().count("coordinator")
    log = (demo.report / "log" / "simulator.log").read_text()
    assert "burger_like.urdf: commandTopic 'cmd_vel' is 'pioneer/cmd_vel' in the fleet" in log
