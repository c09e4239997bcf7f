"""``world_to_map``: draws the occupancy map of a world in map_server's format."""
# ruff: noqa: T201 - a command prints to standard output

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.commands.raster import Extent, grey_map, occupied_cells
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import World
from pioneer_gazebo.world.resource import map_path, model_path, world_path
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_gazebo.world.section import section_of

_YAML = """\
image: {image}
resolution: {resolution:.6g}
origin: [{x:.6g}, {y:.6g}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write_map(path: Path, grey: NDArray[np.uint8], extent: Extent) -> None:
    """Writes ``path`` with the suffixes .yaml and .pgm.

    Args:
        path: with or without a suffix; its directory is created.
        grey: shape (rows, cols), row 0 at the smallest y: 0 occupied, 254 free, 205 unknown.
        extent: position and resolution of the grid.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    image = path.with_suffix(".pgm")
    rows, cols = grey.shape
    image.write_bytes(
        b"P5\n%d %d\n255\n" % (cols, rows) + np.ascontiguousarray(grey[::-1]).tobytes()
    )
    text = _YAML.format(image=image.name, resolution=extent.resolution, x=extent.x, y=extent.y)
    path.with_suffix(".yaml").write_text(text)


LASER_HEIGHT = 0.27
"""Height of the Pioneer's scan plane above the floor [m]."""
EMPTY_SIDE = 50.0
"""Side of the map of an empty world [m]."""


def map_of_world(
    world: World,
    height: float = LASER_HEIGHT,
    resolution: float = 0.05,
    margin: float = 0.5,
    extent: Extent | None = None,
    outside_unknown: bool = True,
    static_only: bool = False,
) -> tuple[NDArray[np.uint8], Extent]:
    """Returns grey values and extent of a world's map: a section at ``height`` [m], with models at their initial poses.

    Args:
        world: the world.
        height: of the section above the world's origin [m].
        resolution: side of a cell [m].
        margin: free space around all models [m]; ignored if ``extent`` is given.
        extent: the grid; by default one that fits.
        outside_unknown: whether space outside closed walls is unknown rather than free.
        static_only: whether to omit dynamic models. Actors are always omitted.
    """
    placed = [one for one in world.collisions(static_only) if one.model.script is None]
    sections = [
        section_of(item.collision.shape, item.pose, height, triangles_of_mesh) for item in placed
    ]
    grid = extent or Extent.around(sections, resolution, margin) or _extent_of(resolution)
    return grey_map(occupied_cells(sections, grid), outside_unknown), grid


def _extent_of(
    resolution: float, x: float = -EMPTY_SIDE / 2, y: float = -EMPTY_SIDE / 2, width: float = EMPTY_SIDE,
    height: float = EMPTY_SIDE,
) -> Extent:  # fmt: skip
    """Returns the grid with this lower left corner and size [m], by default that of an empty world."""
    return Extent(x, y, resolution, round(height / resolution), round(width / resolution))


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line and writes the map; returns the exit status."""
    options = _parser().parse_args(sys.argv[1:] if argv is None else argv)
    try:
        path = world_path(options.world)
        world = world_from_sdf(path, model_path())
        grey, extent = map_of_world(
            world,
            options.height,
            options.resolution,
            options.margin,
            None if options.extent is None else _extent_of(options.resolution, *options.extent),
            options.outside == "unknown",
            options.static_only,
        )
    except DescriptionError as error:
        print(f"world_to_map: {error}", file=sys.stderr)
        return 1
    loose = [model.name for model in world.models if not model.static and model.script is None]
    if loose:
        how = (
            "are left out"
            if options.static_only
            else "are drawn where they start; --static-only leaves them out"
        )
        print(
            f"world_to_map: {len(loose)} models that can move ({', '.join(loose[:3])} …) {how}",
            file=sys.stderr,
        )
    for warning in world.warnings:
        print(f"world_to_map: {warning}", file=sys.stderr)
    target = Path(options.output) if options.output else map_path(path)
    try:
        write_map(target, grey, extent)
    except OSError as error:
        print(
            f"world_to_map: cannot write {error.filename}: {error.strerror}; -o PATH writes elsewhere",
            file=sys.stderr,
        )
        return 1
    print(
        f"{target.with_suffix('.yaml')}: {extent.cols} × {extent.rows} cells of {extent.resolution:g} m"
    )
    return 0


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be above 0, not {text}")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "world_to_map", description="Draws a world's map: what stands in it at one height."
    )
    parser.add_argument(
        "world", help="name of a world of this package, or the path of a .world file"
    )
    parser.add_argument("-o", "--output", help="path of the map without suffix (default: beside the world's file, "
        "where run-multi-pioneer-gazebo-master looks; this package's map/NAME for its own worlds)")  # fmt: skip
    parser.add_argument(
        "--height", type=float, default=LASER_HEIGHT, help="of the cut [m] (default %(default)s)"
    )
    parser.add_argument(
        "--resolution",
        type=_positive,
        default=0.05,
        help="side of a cell [m] (default %(default)s)",
    )
    parser.add_argument(
        "--margin", type=float, default=0.5, help="around the world [m] (default %(default)s)"
    )
    parser.add_argument(
        "--extent",
        type=float,
        nargs=4,
        metavar=("X", "Y", "WIDTH", "HEIGHT"),
        help="lower left corner and size of the map [m], instead of one that fits the world",
    )
    parser.add_argument("--static-only", action="store_true", help="leave out models that can move")
    parser.add_argument(
        "--outside",
        choices=("unknown", "free"),
        default="unknown",
        help="what lies outside closed walls",
    )
    return parser
