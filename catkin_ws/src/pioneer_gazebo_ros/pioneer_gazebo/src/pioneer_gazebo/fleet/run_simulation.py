"""``run-multi-pioneer-gazebo-master``: starts the world, robots and map, and puts their topics on the network."""

import os
import shlex
import threading
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import rosgraph
import rospy
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from std_msgs.msg import Bool
from std_srvs.srv import Empty

from pioneer_gazebo.error import SpawnError
from pioneer_gazebo.fleet.argument import ArgumentError, option, options_from_arguments
from pioneer_gazebo.fleet.drawn_map import read_map
from pioneer_gazebo.fleet.fleet import (
    InitialPose,
    PlacementError,
    check_place,
    pose_of_entry,
    robot_names,
)
from pioneer_gazebo.fleet.pose_file import poses_of_world, read_poses, robots_of_file
from pioneer_gazebo.fleet.session import LaunchFile, Session, SessionError, run_command, succeeds
from pioneer_gazebo.lockstep.lockstep import LOCKSTEP
from pioneer_gazebo.simulation.noise_profile import PROFILES
from pioneer_gazebo.world.pose import quaternion_from_rpy
from pioneer_gazebo.world.resource import map_path, package_directory, world_path
from pioneer_launch import door
from pioneer_node.core.count import counted
from pioneer_node.core.fleet_file import RobotEntry

SPAWN_SERVICE = "/gazebo/spawn_urdf_model"
NAME = "run-multi-pioneer-gazebo-master"
GATEWAY, HUB_GATEWAY = "/gateway", "Hub_Gateway"
FACTOR = "REAL_TIME_FACTOR"
"""Environment variable."""


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Command line options."""

    world_name: str = option("utm_0", "name of a world or path of a .world file", "WORLD")
    robots: int = option(15, "number of robots", "ROBOTS")
    real_time_factor: float = option(
        1.0,
        "speed of simulated time; 0 for as fast as possible; lockstep to wait for the robots' nodes in each period "
        "(docs/lockstep.md)",
        FACTOR,
    )
    seed: int = option(0, "of every random number of the simulation")
    noise: str = option(
        "described",
        "least noise of every robot: described (only that of their descriptions) or realistic",
    )
    map_name: str = option(
        "",
        "map in pioneer_gazebo/map; empty for the world's, which is beside a .world file of your own",
    )
    map_file: str = option("", "path of a map's YAML file, for a map from elsewhere")
    poses: str = option("", "YAML file of initial poses; empty for pioneer_description's")
    fleet: str = option("", "fleet file, in place of robots", "FLEET")
    paused: bool = option(False, "leave the simulation paused")
    gateway: bool = option(True, "put the topics on the network through this master's gateway")
    skip: bool = option(True, "start without robots that cannot be placed; false: end then")
    laser_samples: int = option(180, "beams a scan")
    laser_rate: float = option(10.0, "scans a second [Hz]")
    odom_rate: float = option(100.0, "odometry messages a second [Hz]")
    command_timeout: float = option(
        0.6, "without a command for longer a robot stops [s]; 0 for never"
    )
    camera: bool = option(False, "robots carry cameras")
    sonar: bool = option(False, "robots carry sonars")
    driver: bool = option(
        False, "robots have the topics of a real Pioneer's driver: battery, bumpers, sonar ring"
    )
    parameters: str = option(
        "",
        "YAML file of parameters that replace those of the simulator; names without namespaces inside",
    )
    lockstep: bool = option(False, "the same as real_time_factor:=lockstep")
    lockstep_rings: str = option(
        "", "space-separated rings of nodes that lockstep waits for; empty for the robots"
    )


def options_from(arguments: Sequence[str], environ: Mapping[str, str]) -> SimulationOptions:
    """Returns the options of a command line; the environment provides defaults.

    Raises:
        ArgumentError: unknown name, invalid value, two maps, or lockstep without the patches that it needs.
    """
    defaults = {}
    if environ.get(FACTOR) == LOCKSTEP:
        defaults["lockstep"], environ = True, {**environ, FACTOR: ""}
    arguments = [
        "lockstep:=true" if word == f"real_time_factor:={LOCKSTEP}" else word for word in arguments
    ]
    options = options_from_arguments(SimulationOptions, arguments, environ, **defaults)
    if options.map_name and options.map_file:
        raise ArgumentError("map_name and map_file are two maps: give one")
    if options.noise not in PROFILES:
        raise ArgumentError(f"noise must be {' or '.join(PROFILES)}, not {options.noise!r}")
    if options.lockstep and not door.is_on():
        raise ArgumentError(door.LOCKSTEP_REFUSED)
    return options


def fleet_robots(options: SimulationOptions) -> tuple[RobotEntry, ...]:
    """Returns the robots of the fleet file or, without one, the requested number of Pioneers.

    Raises:
        FleetError: the fleet file is invalid.
    """
    return (
        robots_of_file(options.fleet)
        if options.fleet
        else tuple(map(RobotEntry, robot_names(options.robots)))
    )


def fleet_poses(
    options: SimulationOptions, world: str, robots: Sequence[RobotEntry]
) -> dict[str, InitialPose]:
    """Returns each robot's initial pose, by name, in order."""
    path = Path(options.poses).expanduser() if options.poses else poses_of_world(world)
    content = read_poses(path)
    return {
        one.name: pose_of_entry(one, number, content, str(path))
        for number, one in enumerate(robots, 1)
    }


def launch_files(
    options: SimulationOptions, world: Path, grid: Path, robots: Sequence[RobotEntry]
) -> list[LaunchFile]:
    """Returns all launch files: the world (paused until the robots are spawned), descriptions, robots and map.

    Args:
        options: the command line.
        world: the world's file.
        grid: the map's YAML file.
        robots: the fleet.
    """
    given_by_path = Path(options.world_name).expanduser().is_file()
    simulator = {
        # Nodes have a different working directory.
        "world_name": str(world) if given_by_path else options.world_name,
        "real_time_factor": LOCKSTEP if options.lockstep else str(options.real_time_factor),
        "lockstep_rings": options.lockstep_rings,
        "seed": str(options.seed),
        "noise": options.noise,
        "parameters": options.parameters,
        "paused": "true",
    }
    description = {
        name: str(getattr(options, name)).lower()
        for name in (
            "laser_samples",
            "laser_rate",
            "odom_rate",
            "command_timeout",
            "camera",
            "sonar",
            "driver",
        )
    }
    return [
        ("pioneer_gazebo", "multi_pioneer_world.launch", simulator),
        ("pioneer_description", "robot_description.launch", description),
        *(
            ("pioneer_description", "generic_pioneer.launch", _robot_arguments(robot))
            for robot in robots
        ),
        (
            "pioneer_description",
            "robot_state_publishers.launch",
            {"robots": " ".join(robot.name for robot in robots)},
        ),
        ("nav_bundle", "map_server.launch", {"map_file": str(grid)}),
    ]


def _robot_arguments(robot: RobotEntry) -> dict[str, str]:
    own = {"description": robot.description, "laser": robot.laser} if robot.description else {}
    return {"name": robot.name, "spawn": "false", "state_publisher": "false", **own}


def map_file(options: SimulationOptions, world: Path) -> Path:
    """Returns the YAML file of the map given on the command line, or of the world's map.

    Raises:
        SessionError: there is no such map; the message says how to get one.
    """
    if options.map_file:
        path = Path(options.map_file).expanduser().resolve()
        missing = f"map_file: there is no file {path}"
    elif options.map_name:
        path = (package_directory() or Path()) / "map" / f"{options.map_name}.yaml"
        missing = f"there is no map {options.map_name!r} in {path.parent}; map_file:=PATH takes one from elsewhere"
    else:
        path = map_path(world)
        draw = f"rosrun pioneer_gazebo world_to_map {shlex.quote(str(world))}"
        missing = f"the world has no map {path}: draw it ({draw}), or give map_file:=PATH"
    if not path.is_file():
        raise SessionError(missing)
    return path


def simulate(session: Session, options: SimulationOptions) -> None:
    """Starts everything in order and keeps it running until shutdown is requested."""
    path = world_path(options.world_name)
    world, grid = path.stem, map_file(options, path)
    robots = fleet_robots(options)
    poses = fleet_poses(options, world, robots)
    drawn = read_map(grid)
    poses = _possible(
        session,
        options,
        poses,
        lambda robot, pose: check_place(drawn, robot, pose.x, pose.y, world),
    )
    robots = tuple(robot for robot in robots if robot.name in poses)
    session.wait_for_master()
    if options.gateway:
        _check_master(session)
    # Robots' computers read the world name through the gateways, to choose their initial poses.
    master = rosgraph.Master(f"/{NAME}")
    master.setParam("/world_name", world)
    master.setParam("/robot_names", list(poses))
    session.say(f"starting {world} with {counted(len(poses), 'robot')}")
    session.launch(launch_files(options, path, grid, robots))
    rospy.init_node(
        NAME.replace("-", "_"), anonymous=True, disable_signals=True, disable_rostime=True
    )
    try:
        session.wait_for(
            lambda: succeeds(master.lookupService, SPAWN_SERVICE), "the simulator to load the world"
        )
        ready = threading.Event()
        rospy.Subscriber("/gazebo/ready", Bool, lambda _: ready.set(), queue_size=1)

        def spawn(robot: str, pose: InitialPose) -> None:
            session.check()
            own = f"/{robot}/robot_description"
            name = own if rospy.has_param(own) else "/robot_description"
            _spawn(robot, str(rospy.get_param(name)), pose)

        poses = _possible(session, options, poses, spawn)
        if not options.paused:
            _unpause()
            session.wait_for(ready.is_set, "the simulator's first steps")
        session.say(
            f"{counted(len(poses), 'robot')} {'stands' if len(poses) == 1 else 'stand'} in {world}"
        )
        if options.gateway:
            session.run("rocon_flip", "flip-from-hub", "--advertise", *poses)
            session.say("topics are advertised and flipped")
        session.spin()
    finally:
        rospy.signal_shutdown("the session ends")


def _spawn(robot: str, description: str, pose: InitialPose) -> None:
    """Spawns a robot in the namespace of its name; raises SpawnError."""
    at = Pose(Point(pose.x, pose.y, 0.0), Quaternion(*quaternion_from_rpy(0.0, 0.0, pose.a)))
    try:
        answer = rospy.ServiceProxy(SPAWN_SERVICE, SpawnModel)(
            robot, description, robot, at, "world"
        )
    except rospy.ServiceException as error:
        raise SpawnError(f"spawning {robot} failed: {error}") from None
    if not answer.success:
        raise SpawnError(f"spawning {robot} failed: {answer.status_message}")


def _unpause() -> None:
    try:
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
    except rospy.ServiceException as error:
        raise SpawnError(f"unpausing the simulator failed: {error}") from None


def _possible(
    session: Session, options: SimulationOptions, poses: Mapping[str, InitialPose],
    do: Callable[[str, InitialPose], None],
) -> dict[str, InitialPose]:  # fmt: skip
    """Applies ``do`` to each robot; returns the robots for which it succeeded, and reports the others.

    Raises:
        SimulatorError: it succeeded for no robot or, with ``skip:=false``, failed for one.
    """
    done: dict[str, InitialPose] = {}
    for number, (robot, pose) in enumerate(poses.items(), 1):
        try:
            do(robot, pose)
        except (PlacementError, SpawnError) as error:
            if not options.skip or (number == len(poses) and not done):
                raise
            session.say(f"warning: {error}; {robot} is skipped")
        else:
            done[robot] = pose
    return done


def _check_master(session: Session) -> None:
    """Raises SessionError if this is the hub's own master, or if its gateway is not the one that robots pull from."""
    uri, master = rosgraph.get_master_uri(), rosgraph.Master(f"/{NAME.replace('-', '_')}")
    parameter = f"{GATEWAY}/name"
    # The parameter outlives its gateway.
    name = (
        str(master.getParam(parameter))
        if master.hasParam(parameter) and succeeds(master.lookupNode, GATEWAY)
        else ""
    )
    if not name and succeeds(master.lookupNode, "/hub"):
        port = (urllib.parse.urlsplit(uri).port or 11311) + 1
        raise SessionError(
            f"{uri} is the hub's own ROS master; Hub_Gateway has another: "
            f"export ROS_MASTER_URI=http://localhost:{port} and start this again"
        )
    if name and name != HUB_GATEWAY:
        # A simulator on a robot's master would replace the clock that its navigation uses.
        raise SessionError(
            f"the gateway on {uri} is '{name}', and robots pull from {HUB_GATEWAY}: "
            f"export ROS_MASTER_URI to that one's master (http://localhost:11312) and start this again"
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns the exit status."""
    return run_command(
        NAME, SimulationOptions, partial(options_from, environ=os.environ), simulate, argv
    )
