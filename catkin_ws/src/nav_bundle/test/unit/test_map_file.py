"""Maps are read as map_server reads them; an invalid file gets a one-line error that names it."""

from pathlib import Path

import numpy as np
import pytest
from drawn_room import grid_from_text
from PIL import Image

from nav_bundle.adapters.map_file import (
    MapFileMissingError,
    MapImageError,
    MapMetadataError,
    read_map,
    write_map,
)
from nav_bundle.core.error import MapError
from nav_bundle.core.pose import Pose

YAML = "image: room.pgm\nresolution: 0.1\norigin: [-1, -2, 0.5]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def map_of(folder: Path, pixels: list[list[int]], extra: str = "negate: 0\n") -> Path:
    Image.fromarray(np.array(pixels, np.uint8)).save(folder / "room.pgm")
    path = folder / "room.yaml"
    path.write_text(YAML + extra)
    return path


def test_the_top_row_of_the_image_is_the_last_of_the_map(tmp_path: Path) -> None:
    grid = read_map(map_of(tmp_path, [[0, 205, 254], [254, 254, 254]]))
    assert grid.cells.tolist() == [[0, 0, 0], [100, -1, 0]]
    assert (grid.resolution, grid.origin) == (0.1, Pose(-1.0, -2.0, 0.5))


def test_a_negated_map_has_white_walls(tmp_path: Path) -> None:
    assert read_map(map_of(tmp_path, [[0, 100, 255]], "negate: 1\n")).cells.tolist() == [[0, -1, 100]]


def test_a_scaled_map_keeps_shades(tmp_path: Path) -> None:
    cells = read_map(map_of(tmp_path, [[0, 100, 150, 200, 255]], "negate: 0\nmode: scale\n")).cells[0].tolist()
    assert (cells[0], cells[-1]) == (100, 0)
    assert 99 >= cells[1] > cells[2] > cells[3] >= 1


def test_a_raw_map_is_its_pixels(tmp_path: Path) -> None:
    assert read_map(map_of(tmp_path, [[0, 50, 100, 101]], "mode: raw\n")).cells.tolist() == [[0, 50, 100, -1]]


def test_a_coloured_image_counts_by_its_mean(tmp_path: Path) -> None:
    path = map_of(tmp_path, [[0]])
    pixels = np.array([[[0, 0, 0, 255], [255, 255, 255, 0], [205, 205, 205, 9]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "room.png")
    path.write_text(YAML.replace("pgm", "png"))
    assert read_map(path).cells.tolist() == [[100, 0, -1]]


def test_a_written_map_is_read_back(tmp_path: Path) -> None:
    grid = grid_from_text(["#.?", "..#"], 0.05, Pose(1.5, -2.25, 0.3))
    image, description = write_map(grid, tmp_path / "saved")
    assert (image.name, description.name) == ("saved.pgm", "saved.yaml")
    read = read_map(description)
    assert (read.cells == grid.cells).all()
    assert (read.resolution, read.origin) == (grid.resolution, grid.origin)


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("image: none.pgm\nresolution: 1\norigin: [0, 0, 0]", MapFileMissingError, "none.pgm does not exist"),
        ("image: room.yaml\nresolution: 1\norigin: [0, 0, 0]", MapImageError, "room.yaml is not an image"),
        ("resolution: 1\norigin: [0, 0, 0]", MapMetadataError, "has no image"),
        ("image: a\nresolution: 1\norigin: [0, 0]", MapMetadataError, "does not describe a map"),
        ("image: a\nresolution: 0\norigin: [0, 0, 0]", MapMetadataError, "resolution must be positive"),
        ("image: a\nresolution: 1\norigin: [0, 0, 0]\nmode: dark", MapMetadataError, "mode must be one of"),
        ("image: [", MapMetadataError, "is not valid YAML"),
        ("just words", MapMetadataError, "does not describe a map"),
    ],
)
def test_a_wrong_file_is_named_in_one_line(tmp_path: Path, text: str, error: type[MapError], says: str) -> None:
    (tmp_path / "room.yaml").write_text(text)
    with pytest.raises(error, match=says) as caught:
        read_map(tmp_path / "room.yaml")
    assert "\n" not in str(caught.value)


def test_a_missing_description_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapFileMissingError, match=r"none\.yaml"):
        read_map(tmp_path / "none.yaml")


def test_an_image_cut_short_is_named(tmp_path: Path) -> None:
    path = map_of(tmp_path, [[0] * 50] * 50)
    data = (tmp_path / "room.pgm").read_bytes()
    (tmp_path / "room.pgm").write_bytes(data[:200])
    with pytest.raises(MapImageError, match=r"room\.pgm"):
        read_map(path)
