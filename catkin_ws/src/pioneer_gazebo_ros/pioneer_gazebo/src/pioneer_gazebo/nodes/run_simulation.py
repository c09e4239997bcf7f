"""``run-multi-pioneer-gazebo-master``: the world, its robots, its map, and their topics on the network."""

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rospy

from pioneer_gazebo.adapters.pose_file import poses_of_world, read_poses
from pioneer_gazebo.adapters.resource import package_directory, world_path
from pioneer_gazebo.core.argument import ArgumentError, options_from_arguments, usage, value_from_text
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.fleet import InitialPose, initial_pose, robot_names
from pioneer_gazebo.nodes.session import LaunchFile, Session, SessionError, run_session
from pioneer_gazebo.nodes.simulator_client import SimulatorClient

NAME = "run-multi-pioneer-gazebo-master"


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """The command line."""

    world_name: str = "utm_0"
    robots: int = 15
    real_time_factor: float = 1.0
    seed: int = 0
    map_name: str = ""
    poses: str = ""
    paused: bool = False
    gateway: bool = True
    laser_samples: int = 180
    laser_rate: float = 10.0
    odom_rate: float = 100.0
    command_timeout: float = 0.6
    camera: bool = False
    sonar: bool = False
    driver: bool = False


DOCS = {
    "world_name": "name of a world or path of a .world file; environment: WORLD",
    "robots": "number of robots; environment: ROBOTS",
    "real_time_factor": "speed of simulated time; 0 for as fast as possible",
    "seed": "of every random number of the simulation",
    "map_name": "map in pioneer_gazebo/map; empty for the world's",
    "poses": "YAML file of initial poses; empty for pioneer_description's",
    "paused": "leave the simulation paused",
    "gateway": "put the topics on the network through this master's gateway",
    "laser_samples": "beams a scan",
    "laser_rate": "scans a second [Hz]",
    "odom_rate": "odometry messages a second [Hz]",
    "command_timeout": "without a command for longer a robot stops [s]; 0 for never",
    "camera": "robots carry cameras",
    "sonar": "robots carry sonars",
    "driver": "robots have the topics of a real Pioneer's driver: battery, bumpers, sonar ring",
}


def options_from(arguments: Sequence[str], environ: Mapping[str, str]) -> SimulationOptions:
    """Returns the options of a command line; WORLD and ROBOTS of the environment are defaults.

    Raises:
        ArgumentError: an unknown name or a bad value.
    """
    defaults: dict[str, str | int] = {}
    if environ.get("WORLD"):
        defaults["world_name"] = environ["WORLD"]
    if environ.get("ROBOTS"):
        defaults["robots"] = value_from_text(int, environ["ROBOTS"], "ROBOTS")
    return options_from_arguments(SimulationOptions, arguments, **defaults)


def fleet_poses(options: SimulationOptions, world: str) -> dict[str, InitialPose]:
    """Returns each robot's initial pose, by name, in order."""
    path = Path(options.poses).expanduser() if options.poses else poses_of_world(world)
    content = read_poses(path)
    return {name: initial_pose(content, name, str(path)) for name in robot_names(options.robots)}


def launch_files(options: SimulationOptions, world: str, robots: Sequence[str]) -> list[LaunchFile]:
    """Returns all launch files: the world, paused until the robots stand in it, descriptions, robots and the map."""
    simulator = {
        "world_name": options.world_name,
        "real_time_factor": str(options.real_time_factor),
        "seed": str(options.seed),
        "paused": "true",
    }
    description = {
        name: str(getattr(options, name)).lower()
        for name in ("laser_samples", "laser_rate", "odom_rate", "command_timeout", "camera", "sonar", "driver")
    }
    return [
        ("pioneer_gazebo", "multi_pioneer_world.launch", simulator),
        ("pioneer_description", "robot_description.launch", description),
        *(("pioneer_description", "generic_pioneer.launch", {"name": name, "spawn": "false"}) for name in robots),
        ("nav_bundle", "map_server.launch", {"map_name": options.map_name or world}),
    ]


def _check_map(name: str) -> None:
    package = package_directory()
    if package is None or not (package / "map" / f"{name}.yaml").is_file():
        raise SessionError(
            f"there is no map {name!r}: draw it (rosrun pioneer_gazebo world_to_map), or give map_name:="
        )


def simulate(session: Session, options: SimulationOptions) -> None:
    """Brings everything up in order and keeps it running until the end is asked for."""
    world = world_path(options.world_name).stem
    _check_map(options.map_name or world)
    poses = fleet_poses(options, world)
    session.wait_for_master()
    session.say(f"starting {world} with {len(poses)} robots")
    session.launch(launch_files(options, world, list(poses)))
    rospy.init_node(NAME.replace("-", "_"), anonymous=True, disable_signals=True)
    try:
        client = SimulatorClient()
        session.wait_for(client.serving, "the simulator to load the world")
        description = str(rospy.get_param("/robot_description"))
        for robot, pose in poses.items():
            session.check()
            client.spawn(robot, description, pose)
        if not options.paused:
            client.unpause()
            session.wait_for(client.ready, "the simulator's first steps")
        session.say(f"{len(poses)} robots stand in {world}")
        if options.gateway:
            _connect(session, len(poses))
        session.spin()
    finally:
        rospy.signal_shutdown("the session ends")


def _connect(session: Session, robots: int) -> None:
    session.run("rocon_flip", "advertise-from-hub")
    session.run("rocon_flip", "flip-from-hub", str(robots))
    session.say("topics are advertised and flipped")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    if {"-h", "--help"} & set(words):
        sys.stdout.write(f"usage: {NAME} [name:=value …]\n{usage(SimulationOptions, DOCS)}\n")
        return 0
    try:
        options = options_from(words, os.environ)
    except (ArgumentError, SimulatorError) as error:
        sys.stderr.write(f"{NAME}: {error}\n")
        return 2
    return run_session(NAME, lambda session: simulate(session, options))
