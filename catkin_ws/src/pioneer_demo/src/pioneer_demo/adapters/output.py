"""Checks and prepares a command's output files before anything is started."""

import os
from pathlib import Path

import yaml

from pioneer_demo.core.command import written_files
from pioneer_demo.core.error import OptionError
from pioneer_demo.core.option import DemoConfig, FleetConfig


def make_outputs(config: FleetConfig) -> None:
    """Checks the output paths; creates the output folders and the files that the fleet's commands read.

    Raises:
        OptionError: an output cannot be written.
        VideoError: no video can be made.
    """
    if isinstance(config, DemoConfig) and config.video is not None:
        _check_folder("--video", config.video.parent)
        from pioneer_demo.adapters.video import encoder

        encoder()
    if config.record is not None:
        _check_folder("--record", config.record.parent)
    option, folder = config.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OptionError(f"{option} must be a folder; {folder} is a file") from None
    except OSError as error:
        raise OptionError(f"{option}: cannot create the folder {folder} ({error.strerror})") from None
    _check_folder(option, folder)
    for name, content in written_files(config).items():
        config.log.mkdir(exist_ok=True)
        (config.log / name).write_text(yaml.safe_dump(content))


def _check_folder(option: str, folder: Path) -> None:
    if not folder.is_dir():
        raise OptionError(f"{option}: there is no folder {folder}; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OptionError(f"{option}: you may not write to the folder {folder}")
