"""Finds worlds, models, meshes and maps on the search paths of the environment and this workspace."""

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

import rospkg

from pioneer_gazebo.error import DescriptionError

LARGEST = 256 << 20
"""Maximum file size [bytes]."""


def content_of(path: str | Path) -> bytes:
    """Returns a file's content. Pipes and devices are refused without blocking, since they may never end.

    Raises:
        DescriptionError: it cannot be read, is not a regular file, or is too large.
    """
    try:
        with open(
            path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
        ) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise DescriptionError(f"{path}: is not a regular file")
            if status.st_size > LARGEST:
                raise DescriptionError(
                    f"{path}: {status.st_size >> 20} MiB exceed the limit of {LARGEST >> 20}"
                )
            return file.read(LARGEST)
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from None


PACKAGE = "pioneer_gazebo"


def package_directory(name: str = PACKAGE) -> Path | None:
    """Returns the source or install directory of a ROS package; None if there is no such package."""
    try:
        return Path(rospkg.RosPack().get_path(name))
    except rospkg.ResourceNotFound:
        return None


def _directories(variable: str) -> list[Path]:
    """Returns the directories in an environment variable."""
    return [
        Path(part).expanduser() for part in os.environ.get(variable, "").split(os.pathsep) if part
    ]


def model_path() -> list[Path]:
    """Returns the search path for ``model://``: GAZEBO_MODEL_PATH, this package's models, ~/.gazebo/models."""
    here = package_directory()
    own = [here / "models"] if here else []
    return [*_directories("GAZEBO_MODEL_PATH"), *own, Path("~/.gazebo/models").expanduser()]


def world_path(name: str) -> Path:
    """Returns the file of a world given by name (``closed_maze``) or path.

    A name is searched in this package's ``worlds``, then in ``worlds`` along GAZEBO_RESOURCE_PATH.

    Raises:
        DescriptionError: there is no such world; the message lists this package's worlds.
    """
    direct = Path(name).expanduser()
    if direct.is_file():
        return direct.resolve()
    here = package_directory()
    own = [here / "worlds"] if here else []
    for folder in own + [path / "worlds" for path in _directories("GAZEBO_RESOURCE_PATH")]:
        for candidate in (folder / name, folder / f"{name}.world"):
            if candidate.is_file():
                return candidate.resolve()
    known = sorted(path.stem for folder in own for path in folder.glob("*.world"))
    raise DescriptionError(
        f"no world {name!r}: give the path of a .world file or one of {', '.join(known) or 'none'}"
    )


def map_path(world: Path) -> Path:
    """Returns the map path of a world: in this package's ``map`` for its own worlds, otherwise beside the world file.

    Args:
        world: as returned by ``world_path``.
    """
    here = package_directory()
    is_own = here is not None and world.parent == (here / "worlds").resolve()
    return (here / "map" if here is not None and is_own else world.parent) / f"{world.stem}.yaml"


def file_of_uri(uri: str, relative_to: Path, models: Sequence[Path]) -> Path | None:
    """Returns the file or directory of a URI; None if not found.

    Args:
        uri: ``model://NAME/…``, ``package://NAME/…``, ``file://…`` or a plain path.
        relative_to: directory of the file that contains the URI.
        models: search path of ``model://``.

    A relative path is searched beside the file, along GAZEBO_RESOURCE_PATH and ``models``, in the working directory,
    and in the parent of each of these: ``file://models/x`` finds an ``x`` along ``models``. ``model://NAME`` is
    searched along ``models``, then in the two folders above the file's directory.
    """
    scheme, separator, rest = unquote(uri).partition("://")
    if not separator:
        scheme, rest = "file", uri
    if scheme == "package":
        package, _, inside = rest.partition("/")
        found = package_directory(package)
        candidates = [found / inside] if found else []
    elif scheme == "model":
        candidates = [
            folder / rest for folder in (*models, relative_to.parent, relative_to.parent.parent)
        ]
    elif scheme == "file":
        folders = (relative_to, *_directories("GAZEBO_RESOURCE_PATH"), *models, Path.cwd())
        candidates = [
            folder / rest for folder in (*folders, *(folder.parent for folder in folders))
        ]
    else:
        candidates = []
    return next((path for path in candidates if path.exists()), None)
