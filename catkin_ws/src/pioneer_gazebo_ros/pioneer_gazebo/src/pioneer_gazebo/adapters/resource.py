"""Finds worlds, models, meshes and maps on the search paths of the environment and this workspace."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote

import rospkg

from pioneer_gazebo.core.error import DescriptionError

PACKAGE = "pioneer_gazebo"


def package_directory(name: str = PACKAGE) -> Path | None:
    """Returns the source or install directory of a ROS package; None if there is no such package."""
    try:
        return Path(rospkg.RosPack().get_path(name))
    except rospkg.ResourceNotFound:
        return None


def _directories(value: str) -> list[Path]:
    return [Path(part).expanduser() for part in value.split(os.pathsep) if part]


def resource_path(environ: Mapping[str, str] = os.environ) -> list[Path]:
    """Returns the search path for relative paths: GAZEBO_RESOURCE_PATH."""
    return _directories(environ.get("GAZEBO_RESOURCE_PATH", ""))


def model_path(environ: Mapping[str, str] = os.environ) -> list[Path]:
    """Returns the search path for ``model://``: GAZEBO_MODEL_PATH, this package's models, ~/.gazebo/models."""
    here = package_directory()
    own = [here / "models"] if here else []
    return [*_directories(environ.get("GAZEBO_MODEL_PATH", "")), *own, Path("~/.gazebo/models").expanduser()]


def world_path(name: str, environ: Mapping[str, str] = os.environ) -> Path:
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
    folders = own + [path / "worlds" for path in resource_path(environ)]
    for folder in folders:
        for candidate in (folder / name, folder / f"{name}.world"):
            if candidate.is_file():
                return candidate.resolve()
    known = sorted(path.stem for folder in own for path in folder.glob("*.world"))
    raise DescriptionError(f"no world {name!r}: give the path of a .world file or one of {', '.join(known) or 'none'}")


def map_path(world: Path) -> Path:
    """Returns the map path of a world: in this package's ``map`` for its own worlds, otherwise beside the world file.

    Args:
        world: as returned by ``world_path``.
    """
    here = package_directory()
    own = here is not None and world.parent == (here / "worlds").resolve()
    folder = here / "map" if here is not None and own else world.parent
    return folder / f"{world.stem}.yaml"


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
        candidates = [folder / rest for folder in (*models, relative_to.parent, relative_to.parent.parent)]
    elif scheme == "file":
        folders = (relative_to, *resource_path(), *models, Path.cwd())
        candidates = [folder / rest for folder in (*folders, *(folder.parent for folder in folders))]
    else:
        candidates = []
    return next((path for path in candidates if path.exists()), None)
