"""``run-pioneer-nav-local``: starts one robot's topics, localisation and navigation on the robot's computer."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import rosgraph
import yaml

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.fleet.argument import ArgumentError, option, options_from_arguments
from pioneer_gazebo.fleet.drawn_map import read_map
from pioneer_gazebo.fleet.fleet import (
    FleetError,
    InitialPose,
    check_place,
    pose_of_entry,
    robot_of_host,
)
from pioneer_gazebo.fleet.pose_file import poses_of_world, read_poses, robots_of_file
from pioneer_gazebo.fleet.session import LaunchFile, Session, SessionError, host_name, run_command
from pioneer_gazebo.lockstep.lockstep import LOCKSTEP
from pioneer_gazebo.world.resource import package_directory
from pioneer_node.core.fleet_file import RobotEntry

NAME = "run-pioneer-nav-local"
CORRECTION = "AMCL_CORRECTION_FILE"
"""Environment variable: the file in which amcl stores the pose of the odometry frame in the map."""
GATEWAY: LaunchFile = ("pioneer_networking", "pioneer_gateway.launch", {})
WORLD = "/world_name"
"""Parameter with the name of the world simulated by the base station."""


@dataclass(frozen=True, slots=True)
class NavigationOptions:
    """Command line options."""

    robot_name: str = option(
        "", "the robot driven from here, else pioneerX on a host aadiX", "ROBOT_NAME"
    )
    world_name: str = option(
        "", "the world it stands in, for its initial pose; empty for the base station's", "WORLD"
    )
    poses: str = option("", "YAML file of initial poses; empty for pioneer_description's")
    fleet: str = option(
        "", "fleet file that has the robot's pose, laser topic and move_base parameters", "FLEET"
    )
    gateway: bool = option(True, "pull and flip the robot's topics through this master's gateway")
    start_gateway: bool = option(
        False, "start that gateway, too, and the master: step 2 under the same launcher"
    )
    traffic: bool = option(
        False, "keep the right of way with the other robots that do (pioneer_traffic)"
    )
    navigation: str = option(
        "",
        "YAML file of move_base parameters; none: no amcl and move_base, for another navigation such as Nav2; "
        "empty for the fleet file's",
    )
    parameters: str = option(
        "",
        "YAML file of parameters that replace those of the robot's nodes, named as amcl/min_particles",
    )
    real_time_factor: str = option(
        "", "lockstep where the simulator runs so, else ignored", "REAL_TIME_FACTOR"
    )


def options_from(
    arguments: Sequence[str], environ: Mapping[str, str], host: str
) -> NavigationOptions:
    """Returns the options of a command line; environment and host provide defaults.

    Raises:
        ArgumentError: unknown name, invalid value, or no robot name.
    """
    options = options_from_arguments(
        NavigationOptions, arguments, environ, robot_name=robot_of_host(host) or ""
    )
    if not options.robot_name:
        raise ArgumentError(
            f"no robot name; set robot_name:= or ROBOT_NAME (host {host} is not named aadiX)"
        )
    return options


def entry_of(options: NavigationOptions) -> tuple[RobotEntry, int]:
    """Returns the robot's entry in the fleet file and its position there; without a file, a Pioneer of that name.

    Raises:
        FleetError: the file is invalid, or does not contain the robot.
    """
    if not options.fleet:
        return RobotEntry(options.robot_name), 0
    robots = robots_of_file(options.fleet)
    for number, robot in enumerate(robots, 1):
        if robot.name == options.robot_name:
            return robot, number
    raise FleetError(
        f"{options.fleet} has no robot {options.robot_name}; it has {', '.join(one.name for one in robots)}"
    )


def launch_files(
    robot: RobotEntry,
    pose: InitialPose,
    poses: str,
    traffic: bool = False,
    parameters: str = "",
    lockstep: bool = False,
) -> list[LaunchFile]:
    """Returns the launch files for one robot's computer."""
    start = {"robot_name": robot.name, "x": str(pose.x), "y": str(pose.y), "yaw": str(pose.a)}
    start |= {"laser": robot.laser, "navigation": robot.navigation, "traffic": str(traffic).lower()}
    start |= {"parameters": parameters}
    if lockstep:
        start["real_time_factor"] = LOCKSTEP
    return [
        ("pioneer_description", "robot_description.launch", {"poses": poses}),
        ("nav_bundle", "single_navigation.launch", start),
    ]


def start_pose(options: NavigationOptions, world: str) -> tuple[InitialPose, Path]:
    """Returns the robot's initial pose and its file; the pose is checked against the world's map if that is available.

    Raises:
        FleetError: there is no initial pose.
        PlacementError: no robot can start there.
    """
    poses = Path(options.poses).expanduser() if options.poses else poses_of_world(world)
    pose = pose_of_entry(*entry_of(options), read_poses(poses), str(poses))
    grid = (package_directory() or Path()) / "map" / f"{world}.yaml"
    check_place(
        read_map(grid) if grid.is_file() else None, options.robot_name, pose.x, pose.y, world
    )
    return pose, poses


def navigate(session: Session, options: NavigationOptions, folder: Path) -> None:
    """Starts the robot's navigation and keeps it running until shutdown is requested.

    Args:
        session: the command's.
        options: of the command line.
        folder: for files of its own.

    Raises:
        SessionError: the base station simulates another world than ``options`` specify.
    """
    wanted = Path(options.world_name).stem
    if wanted:
        start_pose(options, wanted)  # fails early, before waiting
    if options.start_gateway:
        session.launch([GATEWAY])
    session.wait_for_master()
    master = rosgraph.Master(f"/{NAME}")
    if not wanted and options.gateway:
        session.run("rocon_flip", "pull-from-hub")
    # If the world is given, there is no need to wait for the base station.
    world = _world_here(session, master) if not wanted or master.hasParam(WORLD) else wanted
    _check_world(wanted or world, world)
    pose, poses = start_pose(options, world)
    # Must precede all nodes, which read it once.
    master.setParam("/use_sim_time", True)
    session.say(f"starting the navigation of {options.robot_name} in {world}")
    robot, _ = entry_of(options)
    if options.navigation:
        robot = replace(robot, navigation=options.navigation)
    elif robot.description and not robot.navigation:
        robot = replace(robot, navigation=_write_footprint(session, robot, folder))
    lockstep = options.real_time_factor == LOCKSTEP
    session.launch(
        launch_files(robot, pose, str(poses), options.traffic, options.parameters, lockstep)
    )
    if options.gateway:
        session.run(
            "rocon_flip",
            "flip-from-remote",
            *(["--pull"] if wanted else []),
            robot.name,
            robot.laser,
        )
        if options.traffic:
            session.run("rocon_flip", "flip-traffic")
        if lockstep:
            session.run("rocon_flip", "flip-lockstep", robot.name)
        session.say("topics are pulled and flipped")
        _check_world(world, _world_here(session, master))
    session.spin()


def _write_footprint(session: Session, robot: RobotEntry, folder: Path) -> str:
    """Writes move_base parameters with the footprint of a robot's description.

    Returns:
        The file; empty if the description has no footprint: then the robot has that of a Pioneer.
    """
    # Loading scipy takes long, and Pioneers have no need of it.
    from pioneer_gazebo.fleet.fleet_description import expanded, fleet_description
    from pioneer_gazebo.fleet.footprint import footprint

    try:
        described = fleet_description(expanded(Path(robot.description)), robot.laser)
        corners = footprint(described.text)
    except DescriptionError as error:
        session.say(f"warning: {robot.name} gets the footprint of a Pioneer: {error}")
        return ""
    session.say(f"the footprint of {robot.name} is that of its description: {corners}")
    costmap = {"footprint": corners}
    path = folder / "footprint.yaml"
    path.write_text(yaml.safe_dump({"global_costmap": costmap, "local_costmap": costmap}))
    return str(path)


def _world_here(session: Session, master: rosgraph.Master) -> str:
    """Waits for the name of the base station's world, which the gateway copies to this master."""
    session.wait_for(lambda: master.hasParam(WORLD), "the base station's world (step 3)")
    return str(master.getParam(WORLD))


def _check_world(wanted: str, simulated: str) -> None:
    if wanted != simulated:
        raise SessionError(
            f"the base station simulates {simulated}, but this computer was started for {wanted}: "
            "leave out world_name:= and WORLD here, or give both computers the same world"
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns the exit status."""
    with tempfile.TemporaryDirectory(prefix=f"{NAME}-") as folder:
        # amcl is restarted if it dies; it then resumes at the robot's current pose.
        os.environ.setdefault(CORRECTION, f"{folder}/correction.json")
        read = partial(options_from, environ=os.environ, host=host_name())
        run = partial(navigate, folder=Path(folder))
        return run_command(NAME, NavigationOptions, read, run, argv)
