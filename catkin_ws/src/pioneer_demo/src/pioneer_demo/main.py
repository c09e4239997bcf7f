"""Entry point of the commands ``fleet``, ``demo`` and ``run-scenario``."""

import dataclasses
import errno
import functools
import itertools
import json
import os
import secrets
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import rospkg
import yaml

from pioneer_demo.console.interrupt import Interrupt, Interrupted, mute
from pioneer_demo.console.output_folder import FolderLock
from pioneer_demo.console.stopwatch import Stopwatch
from pioneer_demo.error import DemoError, FolderInUseError, OptionError
from pioneer_demo.processes.command import written_files
from pioneer_demo.processes.leftover import await_leftovers
from pioneer_demo.processes.network import enter
from pioneer_demo.processes.processes import FleetProcesses
from pioneer_demo.run.limits import check_limits
from pioneer_demo.scenario.option import CONFIGS, DemoConfig, FleetConfig, Machine
from pioneer_demo.scenario.scenario_file import read_scenario
from pioneer_demo.scenario.world_folder import place_count, places_by_world
from pioneer_harness.error import HarnessError
from pioneer_harness.proc import processors
from pioneer_launch import door
from pioneer_node.adapters.fleet_file import read_fleet
from pioneer_node.core.fleet_file import NO_NAVIGATION, FleetFileError, RobotEntry

_FAILED, _BAD_ARGUMENTS = 1, 2
_FOREIGN = (
    "ROS_HOSTNAME", "ROS_IPV6", "ROS_NAMESPACE", "ROBOT_NAMESPACES", "REAL_TIME_FACTOR", "GATEWAY_NETWORK_INTERFACE",
    "GATEWAY_RELAY_PORT",
)  # fmt: skip
"""Environment variables to unset, because they refer to another fleet or machine."""

_FOOTPRINT_PATIENCE = 90.0
"""Longest time to read a robot's description [s]."""

_LIMITS = {errno.EMFILE: " (see ulimit -n)", errno.ENOMEM: " (see ulimit -v)"}


def main(words: Sequence[str], interrupt: Interrupt) -> int:
    """Runs a command, ``fleet``, ``demo`` or ``run-scenario``, with its options.

    Returns:
        The exit status: 0, 1 for a failure, 2 for bad arguments, 130 after Ctrl-C.
    """
    watch = Stopwatch()
    command, *arguments = words
    for name in _FOREIGN:
        os.environ.pop(name, None)
    try:
        config = _configured(command, arguments)
        check_limits()
        if config.linked:
            enter(words)
        _check_files(config)
        config, lock = _made_output(config)
        with lock:
            interrupt.check()
            return _run(config, watch, interrupt)
    except Interrupted as error:
        print(f"{error}: every process of this {command} has ended.")
        return error.status
    except BrokenPipeError:
        text = f"pioneer {command}: the reader of its output has ended; so has every process of this {command}"
        print(text, file=sys.stderr)
        mute()
        return _FAILED
    except (DemoError, HarnessError, OSError) as error:
        text = (
            f"{error.filename}: {error.strerror}"
            if isinstance(error, OSError) and error.filename
            else str(error)
        )
        if isinstance(error, OSError):
            text += _LIMITS.get(error.errno or 0, "")
        print(f"pioneer {command}: {text}", file=sys.stderr)
        return _BAD_ARGUMENTS if isinstance(error, OptionError) else _FAILED


def _run(config: FleetConfig, watch: Stopwatch, interrupt: Interrupt) -> int:
    await_leftovers(functools.partial(print, flush=True), interrupt.check)
    with FleetProcesses(config) as processes:
        ports = processes.ports
        print(
            f"Ports: {ports}"
            + ("" if ports.are_the_tutorials else " (some of the tutorial's are busy)"),
            flush=True,
        )
        if config.web:
            print(
                f"Fleet page, once it is up: http://127.0.0.1:{ports.page}/#{config.token}",
                flush=True,
            )
        if config.ros2:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            print(f"Door to ROS 2: domain {domain}", flush=True)
        for line in filter(None, (config.choice, config.traffic_line)):
            print(line, flush=True)
        processes.start()
        watch.note("processes started")
        # Imported while the processes start, because imports such as numpy are slow.
        if isinstance(config, DemoConfig):
            from pioneer_demo.run.demo import Demo

            return Demo(config, watch, interrupt, processes).run()
        from pioneer_demo.run.fleet_run import FleetRun

        return FleetRun(config, watch, interrupt, processes).stay_up()


def _configured(command: str, arguments: Sequence[str]) -> FleetConfig:
    """Returns the configuration, validated against this machine."""
    packages = rospkg.RosPack()
    try:
        simulator = Path(packages.get_path("pioneer_gazebo"))
        poses = Path(packages.get_path("pioneer_description")) / "config"
        places = places_by_world(simulator / "map", poses)
        machine = Machine(
            places,
            place_count(poses),
            processors(),
            _names_of,
            read_scenario,
            _external_of,
            lockstep_refusal="" if door.is_on() else door.LOCKSTEP_REFUSED,
            traffic_refusal=functools.partial(_traffic_refusal, simulator),
        )
    except (rospkg.ResourceNotFound, OSError) as error:
        raise DemoError(f"the workspace is not built or not sourced: {error}") from error
    config = CONFIGS[command](arguments, machine)
    if config.web:
        config = dataclasses.replace(config, token=secrets.token_urlsafe(16))
    if not config.is_own_world:
        return config
    world = Path(config.world).expanduser().resolve()
    _check_map(world, simulator)
    return dataclasses.replace(config, world=str(world))


def _names_of(fleet: Path) -> list[str]:
    return [robot.name for robot in _robots_of(fleet)]


def _external_of(fleet: Path) -> list[str]:
    return [robot.name for robot in _robots_of(fleet) if robot.navigation == NO_NAVIGATION]


def _robots_of(fleet: Path) -> Sequence[RobotEntry]:
    try:
        return read_fleet(fleet)
    except FleetFileError as error:
        raise OptionError(f"--fleet: {error}") from None


def _traffic_refusal(simulator: Path, fleet: Path | None, names: Sequence[str], world: str) -> str:
    """Returns why a fleet cannot keep the right of way; empty if it can.

    Args:
        simulator: the folder of pioneer_gazebo.
        fleet: fleet file; None for Pioneers.
        names: of the robots.
        world: name of a world, or path of its file.
    """
    # The import takes 0.2 s of CPU, which other runs need not spend.
    from pioneer_demo.scenario.right_of_way import fleet_refusal

    robots = _robots_of(fleet) if fleet else [RobotEntry(name) for name in names]
    file = Path(world).expanduser().resolve()
    is_file = "/" in world or world.endswith(".world")
    map_file = _map_of(file, simulator) if is_file else simulator / "map" / f"{world}.yaml"
    packages = rospkg.RosPack()
    poses = Path(packages.get_path("pioneer_description")) / "config"
    navigation = Path(packages.get_path("pioneer_2dnav")) / "config"
    shipped = navigation / "costmap_common_params.yaml"
    return fleet_refusal(robots, map_file, poses, shipped, _footprint_of)


def _footprint_of(description: str) -> Sequence[Sequence[float]]:
    """Returns the corners of a robot's footprint [m] from its description.

    Raises:
        ValueError: it has none, or cannot be read.
    """
    command = ["rosrun", "pioneer_gazebo", "fleet_description", "--footprint", description]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_FOOTPRINT_PATIENCE
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ValueError(f"the footprint of {description} is unknown: {error}") from None
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no reason was given"]
        raise ValueError(f"the footprint of {description} is unknown: {lines[-1]}")
    corners: list[list[float]] = json.loads(done.stdout)
    return corners


def _map_of(world: Path, simulator: Path) -> Path:
    """Returns where the map of a world file is; see `_check_map`."""
    folder = simulator / "map" if world.parent == (simulator / "worlds").resolve() else world.parent
    return folder / f"{world.stem}.yaml"


def _check_map(world: Path, simulator: Path) -> None:
    """Checks that a world file's map is where ``run-multi-pioneer-gazebo-master`` expects it.

    Args:
        world: the resolved path of the file.
        simulator: the folder of pioneer_gazebo, whose own worlds have their maps in ``map``.
    """
    if not world.is_file():
        raise OptionError(f"--world: there is no file {world}")
    path = _map_of(world, simulator)
    if not path.is_file():
        draw = f"./pioneer run rosrun pioneer_gazebo world_to_map {shlex.quote(str(world))}"
        raise OptionError(f"--world: it has no map {path}; draw it: {draw}")


def _check_files(config: FleetConfig) -> None:
    """Checks that video and recording can be written.

    Raises:
        OptionError: a folder is missing or read-only.
        VideoError: no video can be made.
    """
    if isinstance(config, DemoConfig) and config.video is not None:
        _check_folder("--video", config.video.parent)
        from pioneer_demo.report.video import encoder

        encoder()
    if config.record is not None:
        _check_folder("--record", config.record.parent)
        if config.record.exists() and not config.force:
            raise OptionError(f"--record: there is a file {config.record}; --force replaces it")


def _made_output(config: FleetConfig) -> tuple[FleetConfig, FolderLock]:
    """Creates the output folder and the files in it that the fleet's commands read.

    A default folder that belongs to a running command is replaced by the first of ``NAME-2``, ``NAME-3``, … that
    does not.

    Returns:
        The configuration with that folder, and the folder's lock.

    Raises:
        OptionError: the folder cannot be written to, or was given and belongs to a running command.
    """
    first = config.output[1]
    own = config
    for number in itertools.count(2):
        try:
            lock = _locked(own)
            break
        except FolderInUseError as error:
            if not config.has_default_output:
                raise OptionError(f"{config.output[0]}: {error}") from None
            own = config.with_output(first.with_name(f"{first.name}-{number}"))
            print(
                f"{error.folder} is in use by {error.owner}: this {config.output[0].strip('-')} goes to",
                end=" ",
            )
            print(own.output[1], flush=True)
    for name, content in written_files(own).items():
        (own.log / name).write_text(yaml.safe_dump(content))
    return own, lock


def _locked(config: FleetConfig) -> FolderLock:
    """Creates and locks the folder of the logs, inside the output folder."""
    option, folder = config.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OptionError(f"{option} must be a folder; {folder} is a file") from None
    except OSError as error:
        raise OptionError(
            f"{option}: cannot create the folder {folder} ({error.strerror})"
        ) from None
    _check_folder(option, folder)
    return FolderLock(config.log)


def _check_folder(option: str, folder: Path) -> None:
    if not folder.is_dir():
        raise OptionError(f"{option}: there is no folder {folder}; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OptionError(f"{option}: you may not write to the folder {folder}")
