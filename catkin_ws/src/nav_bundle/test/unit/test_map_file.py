"""Maps are read as map_server reads them; an invalid file gets a one-line error that names it."""

from pathlib import Path

import numpy as np
import pytest
from drawn_room import grid_from_text
from PIL import Image

from nav_bundle.base.error import MapError
from nav_bundle.base.pose import Pose
from nav_bundle.maps.map_file import (
    MapFileMissingError,
    MapImageError,
    MapMetadataError,
    read_map,
    write_map,
)

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
    assert read_map(map_of(tmp_path, [[0, 100, 255]], "negate: 1\n")).cells.tolist() == [
        [0, -1, 100]
    ]


def test_a_scaled_map_keeps_shades(tmp_path: Path) -> None:
    cells = (
        read_map(map_of(tmp_path, [[0, 100, 150, 200, 255]], "negate: 0\nmode: scale\n"))
        .cells[0]
        .tolist()
    )
    assert (cells[0], cells[-1]) == (100, 0)
    assert 99 >= cells[1] > cells[2] > cells[3] >= 1


def test_a_raw_map_is_its_pixels_as_signed_bytes(tmp_path: Path) -> None:
    pixels = [[0, 50, 100, 101, 150, 255]]
    assert read_map(map_of(tmp_path, pixels, "mode: raw\n")).cells.tolist() == [
        [0, 50, 100, 101, -106, -1]
    ]


def test_a_raw_map_obeys_negate(tmp_path: Path) -> None:
    assert read_map(map_of(tmp_path, [[50, 150]], "mode: raw\nnegate: 1\n")).cells.tolist() == [
        [-51, 105]
    ]


@pytest.mark.parametrize("text", ["0", '"0"', "'0'", "false", '"false"', "0x0"])
def test_a_flag_means_the_same_in_quotes(tmp_path: Path, text: str) -> None:
    assert read_map(map_of(tmp_path, [[0, 254]], f"negate: {text}\n")).cells.tolist() == [[100, 0]]


@pytest.mark.parametrize("text", ["1", '"1"', "true", "2"])
def test_a_flag_that_is_set_means_the_same_in_quotes(tmp_path: Path, text: str) -> None:
    assert read_map(map_of(tmp_path, [[0, 254]], f"negate: {text}\n")).cells.tolist() == [[0, 100]]


def test_thresholds_the_wrong_way_round_are_taken_and_occupied_comes_first(tmp_path: Path) -> None:
    path = map_of(tmp_path, [[0, 128, 254]])
    path.write_text(
        "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\noccupied_thresh: 0.2\nfree_thresh: 0.8\n"
    )
    assert read_map(path).cells.tolist() == [[100, 100, 0]]


def test_a_transparent_shade_is_unknown_in_scale_mode(tmp_path: Path) -> None:
    path = map_of(tmp_path, [[0]])
    # Value and alpha of each pixel.
    pixels = np.array([[[150, 255], [150, 1], [150, 0], [0, 0], [254, 0]]], np.uint8)
    Image.fromarray(pixels, "LA").save(tmp_path / "room.png")
    path.write_text(YAML.replace("pgm", "png") + "mode: scale\n")
    assert read_map(path).cells.tolist() == [[47, 47, -1, 100, 0]]


def test_an_image_above_the_limit_of_pil_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = map_of(tmp_path, [[0] * 40] * 30)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert read_map(path).cells.shape == (30, 40)
    assert Image.MAX_IMAGE_PIXELS == 100


def test_an_image_too_large_for_any_machine_is_named(tmp_path: Path) -> None:
    path = map_of(tmp_path, [[0]])
    (tmp_path / "room.pgm").write_bytes(b"P5\n60000 60000\n255\n" + bytes(10))
    with pytest.raises(MapImageError, match="60000 x 60000 pixels"):
        read_map(path)


def cell_by_the_documented_rules(
    colours: tuple[int, ...], alpha: int, mode: str, negate: bool, occupied: float, free: float
) -> int:
    """Returns a cell as map_server's documentation computes it, one pixel at a time."""
    average = sum(colours) / len(colours)
    if negate:
        average = 255.0 - average
    if mode == "raw":
        value = int(average)
        return value if value < 128 else value - 256
    darkness = (255.0 - average) / 255.0
    if darkness > occupied:
        return 100
    if darkness < free:
        return 0
    if mode == "trinary" or alpha == 0 or free == occupied:
        return -1
    return int(1.0 + 98.0 * (darkness - free) / (occupied - free))


FORMATS = {
    "1": ("png", "bmp", "pbm", "tiff"),
    "L": ("pgm", "png", "bmp", "tiff", "tga"),
    "LA": ("png", "tiff"),
    "RGB": ("ppm", "png", "bmp", "tiff", "tga"),
    "RGBA": ("png", "tiff", "tga", "webp"),
    "I;16": ("png", "tiff"),
}
"""Formats without loss that maps are drawn in, by PIL's mode."""


def drawn_image(mode: str, random: np.random.Generator) -> Image.Image:
    size = (random.integers(1, 9), random.integers(1, 9))
    if mode == "1":
        return Image.fromarray(random.random(size) < 0.5)
    if mode == "I;16":
        return Image.fromarray(random.integers(0, 2**16, size).astype(np.uint16))
    depth = len(mode)
    shades = random.integers(0, 256, (*size, depth)).astype(np.uint8)
    shades[..., -1] = np.where(random.random(size) < 0.3, 0, shades[..., -1])
    return Image.fromarray(shades[..., 0] if depth == 1 else shades, mode)


@pytest.mark.parametrize("mode", FORMATS)
def test_random_maps_of_every_format_follow_the_documented_rules(tmp_path: Path, mode: str) -> None:
    random = np.random.default_rng(39)
    for number in range(60):
        kind = FORMATS[mode][number % len(FORMATS[mode])]
        image = drawn_image(mode, random)
        options = {"lossless": True, "exact": True} if kind == "webp" else {}
        image.save(tmp_path / f"room.{kind}", **options)
        negate = bool(random.integers(2))
        cells_mode = str(random.choice(["trinary", "scale", "raw"]))
        occupied, free = (float(value) for value in random.random(2))
        (tmp_path / "room.yaml").write_text(
            f"image: room.{kind}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: {int(negate)}\nmode: {cells_mode}\n"
            f"occupied_thresh: {occupied!r}\nfree_thresh: {free!r}\n"
        )
        cells = read_map(tmp_path / "room.yaml").cells
        wide = np.asarray(image.convert("L") if mode == "1" else image)
        pixels = (wide >> 8 if mode == "I;16" else wide).reshape(*wide.shape[:2], -1)
        transparent = mode.endswith("A")
        for row, col in np.ndindex(cells.shape):
            values = [int(value) for value in pixels[len(cells) - 1 - row, col]]
            alpha = values.pop() if transparent else 255
            expected = cell_by_the_documented_rules(
                tuple(values), alpha, cells_mode, negate, occupied, free
            )
            assert cells[row, col] == expected, (
                kind,
                cells_mode,
                negate,
                values,
                alpha,
                occupied,
                free,
            )


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
        (
            "image: none.pgm\nresolution: 1\norigin: [0, 0, 0]",
            MapFileMissingError,
            "none.pgm does not exist",
        ),
        (
            "image: room.yaml\nresolution: 1\norigin: [0, 0, 0]",
            MapImageError,
            "room.yaml is not an image",
        ),
        ("resolution: 1\norigin: [0, 0, 0]", MapMetadataError, "has no image"),
        ("image: a\nresolution: 1\norigin: [0, 0]", MapMetadataError, "does not describe a map"),
        (
            "image: a\nresolution: 0\norigin: [0, 0, 0]",
            MapMetadataError,
            "resolution must be positive",
        ),
        (
            "image: a\nresolution: 1\norigin: [0, 0, -nan]",
            MapMetadataError,
            "origin must be three finite numbers",
        ),
        (
            "image: a\nresolution: 1\norigin: [0, .inf, 0]",
            MapMetadataError,
            "origin must be three finite numbers",
        ),
        (
            "image: a\nresolution: 1\norigin: [0, 0, 0]\nnegate: maybe",
            MapMetadataError,
            "negate must be 0 or 1",
        ),
        (
            "image: a\nresolution: 1\norigin: [0, 0, 0]\nfree_thresh: .nan",
            MapMetadataError,
            "must be numbers, not nan",
        ),
        (
            "image: a\nresolution: 1\norigin: [0, 0, 0]\nmode: dark",
            MapMetadataError,
            "mode must be one of",
        ),
        ("image: [", MapMetadataError, "is not valid YAML"),
        ("just words", MapMetadataError, "does not describe a map"),
    ],
)
def test_a_wrong_file_is_named_in_one_line(
    tmp_path: Path, text: str, error: type[MapError], says: str
) -> None:
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
