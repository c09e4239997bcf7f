"""The command: arguments in, exit status out."""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import rospkg
import yaml

from pioneer_demo.adapters.interrupt import Interrupt, Interrupted
from pioneer_demo.adapters.map_file import map_names
from pioneer_demo.adapters.processes import FleetProcesses
from pioneer_demo.adapters.stopwatch import Stopwatch
from pioneer_demo.core.error import DemoError, OptionError
from pioneer_demo.core.option import DemoConfig, config_from_arguments
from pioneer_harness.error import HarnessError

_FAILED, _BAD_ARGUMENTS = 1, 2


def main(arguments: Sequence[str]) -> int:
    """Runs a demo and returns its exit status: 0, 1 for a failure, 2 for bad arguments, 130 after Ctrl-C."""
    watch, interrupt = Stopwatch(), Interrupt()
    try:
        config, maps = _configured(arguments)
        return _run(config, maps / f"{config.map_name}.yaml", watch, interrupt)
    except Interrupted as error:
        print(f"{error}: every process of this demo has ended.")
        return error.status
    except OptionError as error:
        print(f"pioneer demo: {error}", file=sys.stderr)
        return _BAD_ARGUMENTS
    except (DemoError, HarnessError, OSError) as error:
        print(f"pioneer demo: {error}", file=sys.stderr)
        return _FAILED


def _run(config: DemoConfig, map_file: Path, watch: Stopwatch, interrupt: Interrupt) -> int:
    if config.video is not None:
        from pioneer_demo.adapters.video import encoder

        encoder()
        config.video.parent.mkdir(parents=True, exist_ok=True)
    config.report.mkdir(parents=True, exist_ok=True)
    with FleetProcesses(config, config.report / "log") as processes:
        ports = processes.ports
        print(f"Ports: {ports}" + ("" if ports.are_the_tutorials else " (some of the tutorial's are busy)"), flush=True)
        processes.start()
        watch.note("processes started")
        # Imported while the processes start, because numpy and the like take their time.
        from pioneer_demo.nodes.demo import Demo

        return Demo(config, map_file, watch, interrupt, processes).run()


def _configured(arguments: Sequence[str]) -> tuple[DemoConfig, Path]:
    """Returns the configuration and the folder of maps."""
    packages = rospkg.RosPack()
    try:
        maps = Path(packages.get_path("pioneer_gazebo")) / "map"
        poses = Path(packages.get_path("pioneer_description")) / "config"
        places = {world: _count(poses, world) for world in map_names(maps)}
    except (rospkg.ResourceNotFound, OSError) as error:
        raise DemoError(f"the workspace is not built or not sourced: {error}") from error
    config = config_from_arguments(arguments, places)
    if "/" in config.world or config.world.endswith(".world"):
        path = Path(config.world).expanduser().resolve()
        if not path.is_file():
            raise OptionError(f"--world: there is no file {path}")
        config = dataclasses.replace(config, world=str(path))
    return config, maps


def _count(poses: Path, world: str) -> int:
    """Returns how many robots have an initial pose in a world: its own file's, else those of the common one."""
    own = poses / f"pioneer_poses_{world}.yaml"
    return len(yaml.safe_load((own if own.is_file() else poses / "pioneer_poses.yaml").read_text()))
