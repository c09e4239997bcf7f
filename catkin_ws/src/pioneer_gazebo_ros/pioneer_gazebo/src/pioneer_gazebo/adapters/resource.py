"""Where worlds, models, meshes and maps are found: search paths of the environment and of this workspace."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote

import rospkg

from pioneer_gazebo.core.error import DescriptionError

PACKAGE = "pioneer_gazebo"


def package_directory(name: str = PACKAGE) -> Path | None:
    """Returns the source or installed directory of a ROS package, or None where there is no such package."""
    try:
        return Path(rospkg.RosPack().get_path(name))
    except rospkg.ResourceNotFound:
        return None


def _directories(value: str) -> list[Path]:
    return [Path(part).expanduser() for part in value.split(os.pathsep) if part]


def resource_path(environ: Mapping[str, str] = os.environ) -> list[Path]:
    """Returns where relative paths are looked up: GAZEBO_RESOURCE_PATH."""
    return _directories(environ.get("GAZEBO_RESOURCE_PATH", ""))


def model_path(environ: Mapping[str, str] = os.environ) -> list[Path]:
    """Returns where ``model://`` is looked up: GAZEBO_MODEL_PATH, this package's models, ~/.gazebo/models."""
    here = package_directory()
    own = [here / "models"] if here else []
    return [*_directories(environ.get("GAZEBO_MODEL_PATH", "")), *own, Path("~/.gazebo/models").expanduser()]


def world_path(name: str, environ: Mapping[str, str] = os.environ) -> Path:
    """Returns the file of a world given by name (``closed_maze``) or by path.

    A name is looked up in this package's ``worlds``, then in ``worlds`` along GAZEBO_RESOURCE_PATH.

    Raises:
        DescriptionError: there is no such world; the message lists those of this package.
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
    """Returns where the map of a world's file belongs: this package's ``map`` for its own worlds, else beside the file.

    Args:
        world: as ``world_path`` returns it.
    """
    here = package_directory()
    own = here is not None and world.parent == (here / "worlds").resolve()
    folder = here / "map" if here is not None and own else world.parent
    return folder / f"{world.stem}.yaml"


def file_of_uri(uri: str, relative_to: Path, models: Sequence[Path]) -> Path | None:
    """Returns the file or directory of a URI, or None where nothing is found.

    Args:
        uri: ``model://NAME/…``, ``package://NAME/…``, ``file://…`` or a plain path.
        relative_to: directory of the file that names it.
        models: search path of ``model://``.

    A relative path is looked up beside the file, along GAZEBO_RESOURCE_PATH and ``models``, in the working directory,
    and in the folders above each: ``file://models/x`` is found where ``x`` is along ``models``. So is ``model://NAME``,
    after ``models``, in the folders above the file.
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
