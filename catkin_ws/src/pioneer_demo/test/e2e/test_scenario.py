"""Scenarios, run by their own command."""

import json

WHOLE = 300.0


def test_the_shipped_mapping_scenario_starts_each_robots_program_and_succeeds(start):
    run = start("mapping", "--lockstep", command="run-scenario")
    assert run.process.wait(WHOLE) == 0, run.text()
    for robot in ("pioneer1", "pioneer2"):
        assert "Traceback" not in (run.report / "log" / f"program-1-of-{robot}.log").read_text()


def test_a_robot_whose_computer_is_killed_gets_its_waypoints_again_and_a_door_closes(
    start, tmp_path
):
    scenario = tmp_path / "outage.yaml"
    scenario.write_text(
        "world: small_world\n"
        "robots:\n"
        "  - goals: [[-4.0, 1.5]]\n"
        "parameters: {amcl/min_particles: 400, /gazebo/odometry_error: 0.001}\n"
        "faults:\n"
        "  - {at: 0.5, kill: pioneer1, lasts: 2}\n"
        "  - {at: 1.0, kill: hub, lasts: 2}\n"
        "  - {at: 1.0, door: [0.0, 0.0, 90.0, 1.0], lasts: 1}\n"
        "success: {localisation_error: 0.3}\n"
    )
    run = start(scenario, command="run-scenario")
    assert run.process.wait(WHOLE) == 0, run.text()
    assert run.processes() == {}
    for line in (
        "the computer of pioneer1 is killed",
        "over: the hub is killed",
        "over: a door at (0, 0) is closed",
    ):
        assert line in run.text()
    numbers = json.loads((run.report / "report.json").read_text())
    assert numbers["robots"]["pioneer1"]["reached"] == 1
    assert len(numbers["settings"]["disturbances"]) == 3
    assert numbers["drive"]["bytes"] > numbers["drive"]["messages"] > 100
