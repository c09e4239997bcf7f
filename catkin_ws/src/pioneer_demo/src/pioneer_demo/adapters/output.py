"""The files that a demo writes, checked before anything is started."""

import os
from pathlib import Path

from pioneer_demo.core.error import OptionError
from pioneer_demo.core.option import DemoConfig


def make_outputs(config: DemoConfig) -> None:
    """Creates the report's folder, after a check of where the film goes.

    Raises:
        OptionError: one of them cannot be written.
        VideoError: no film can be made.
    """
    if config.video is not None:
        _check_folder("--video", config.video.parent)
        from pioneer_demo.adapters.video import encoder

        encoder()
    try:
        config.report.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OptionError(f"--report must be a folder; {config.report} is a file") from None
    except OSError as error:
        raise OptionError(f"--report: cannot create the folder {config.report} ({error.strerror})") from None
    _check_folder("--report", config.report)


def _check_folder(option: str, folder: Path) -> None:
    if not folder.is_dir():
        raise OptionError(f"{option}: there is no folder {folder}; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OptionError(f"{option}: you may not write to the folder {folder}")
