"""Keeps roadmaps on the disk: all robots of a machine have the same one, and making it takes seconds.

A file below ``XDG_CACHE_HOME`` or ``~/.cache`` holds places and ways of one map. Its name is a checksum of the free
space, the geometry, and the source that makes roadmaps. Only the newest files are kept, as a map that is being made
changes every few seconds. They may be deleted at any time.
"""

import contextlib
import fcntl
import hashlib
import inspect
import json
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pioneer_traffic import geometry, roadmap
from pioneer_traffic.geometry import Point
from pioneer_traffic.roadmap import FreeSpace, Roadmap, RoadmapConfig, roadmap_from_space

_PATIENCE = 30.0
"""Longest time to wait for another process that makes the same roadmap [s]."""
_LOOK = 0.1
"""Interval at which the other process is checked [s]: a file's lock cannot be awaited with a time limit."""
_KEPT = 50
"""Number of roadmaps that are kept."""


def cache_folder() -> Path:
    """Returns the folder of the files."""
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(caches) / "pioneer" / "roadmaps"


def cached_roadmap(space: FreeSpace, config: RoadmapConfig | None = None) -> Roadmap:
    """Returns the same as `roadmap_from_space`, from the cache if it is there.

    Of several processes that need the same roadmap at once, one makes it. A cache that cannot be read or written is
    ignored.
    """
    config = config or RoadmapConfig()
    path = cache_folder() / f"{_key(space, config)}.json"
    found = _read(path, space, config)
    if found is not None:
        return found
    with _alone(path.with_suffix(".lock")):
        found = _read(path, space, config)
        if found is not None:
            return found
        made = roadmap_from_space(space, config)
        _write(path, made)
        return made


def _key(space: FreeSpace, config: RoadmapConfig) -> str:
    digest = hashlib.sha256()
    for module in (roadmap, geometry):
        digest.update(inspect.getsource(module).encode())
    about = (space.room.shape, space.resolution, space.corner, space.yaw, config)
    digest.update(repr(about).encode())
    digest.update(space.room.tobytes())
    return digest.hexdigest()


def _read(path: Path, space: FreeSpace, config: RoadmapConfig) -> Roadmap | None:
    """Returns the roadmap of a file; None if there is none, or it is damaged."""
    try:
        places, neighbours = _checked(json.loads(path.read_text()))
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return Roadmap(places, neighbours, config, space)


def _checked(content: Any) -> tuple[list[Point], list[list[int]]]:
    """Returns places and neighbours.

    Raises:
        ValueError, TypeError, KeyError: these are not those of a roadmap.
    """
    places = [(float(x), float(y)) for x, y in content["places"]]
    neighbours = [[int(one) for one in ends] for ends in content["neighbours"]]
    if len(neighbours) != len(places):
        raise ValueError("places and their neighbours differ in number")
    if any(not 0 <= one < len(places) for ends in neighbours for one in ends):
        raise ValueError("a way leads nowhere")
    return places, neighbours


def _write(path: Path, made: Roadmap) -> None:
    """Writes a file at once, or not at all."""
    text = json.dumps({"places": made.places, "neighbours": made.neighbours})
    try:
        with tempfile.NamedTemporaryFile("w", dir=path.parent, suffix=".part", delete=False) as new:
            new.write(text)
        os.replace(new.name, path)
        _remove_oldest(path.parent)
    except OSError:
        return  # a read-only or full disk: the roadmap is made again next time


def _remove_oldest(folder: Path) -> None:
    """Removes all roadmaps but the newest, with their locks."""
    files = sorted(folder.glob("*.json"), key=lambda file: file.stat().st_mtime)
    for file in files[:-_KEPT]:
        file.unlink(missing_ok=True)
        file.with_suffix(".lock").unlink(missing_ok=True)


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Waits until no other process is in this block with the same file, or `_PATIENCE` has passed."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
    except OSError:
        yield  # nothing can be kept here
        return
    with file:
        end = time.monotonic() + _PATIENCE
        while not _is_locked(file.fileno()) and time.monotonic() < end:
            time.sleep(_LOOK)
        yield


def _is_locked(file: int) -> bool:
    """Locks a file if nobody else has; returns whether it is ours."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
