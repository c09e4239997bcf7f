"""Roadmaps are kept on the disk: what is read is what was made, and damage costs only time."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pioneer_traffic import roadmap_cache
from pioneer_traffic.roadmap import FreeSpace, RoadmapConfig, roadmap_from_space
from pioneer_traffic.roadmap_cache import cache_folder, cached_roadmap


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def drawn(seed: int) -> FreeSpace:
    """Returns a room with boxes in it, 8 m x 8 m, turned a bit."""
    rng = np.random.default_rng(seed)
    free = np.zeros((160, 160), bool)
    free[4:-4, 4:-4] = True
    for _ in range(6):
        row, col = rng.integers(10, 130, 2)
        free[row : row + rng.integers(4, 20), col : col + rng.integers(4, 20)] = False
    return FreeSpace.of(free, 0.05, tuple(rng.uniform(-5, 5, 2).tolist()), float(rng.uniform(0, 1)))


def files() -> list[Path]:
    return sorted(cache_folder().glob("*.json"))


@pytest.mark.parametrize("seed", range(5))
def test_a_roadmap_of_the_cache_is_the_one_that_was_made_to_the_last_bit(seed: int) -> None:
    space = drawn(seed)
    made = roadmap_from_space(space)
    for _ in range(2):
        found = cached_roadmap(space)
        assert (found.places, found.neighbours) == (made.places, made.neighbours)
        assert (found.signature, found.config, found.space) == (made.signature, made.config, space)
    assert len(files()) == 1


def test_what_is_in_the_cache_is_not_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    space = drawn(1)
    made = cached_roadmap(space)
    monkeypatch.setattr(roadmap_cache, "roadmap_from_space", None)
    assert cached_roadmap(space).places == made.places


def test_another_map_or_geometry_is_another_file() -> None:
    cached_roadmap(drawn(1))
    cached_roadmap(drawn(2))
    cached_roadmap(drawn(1), RoadmapConfig(spacing=1.1))
    assert len(files()) == 3


def test_only_the_newest_roadmaps_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map that is being made changes every few seconds, and each has a roadmap of its own."""
    monkeypatch.setattr(roadmap_cache, "_KEPT", 2)
    for number, seed in enumerate((1, 2, 3)):
        cached_roadmap(drawn(seed))
        for file in files():
            if file.stat().st_mtime > 1000.0:
                os.utime(file, (number, number))
    assert [
        file.stat().st_mtime for file in sorted(files(), key=lambda one: one.stat().st_mtime)
    ] == [1, 2]
    assert len(list(cache_folder().iterdir())) == 4


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "null",
        '{"places": [[0, 0]]}',
        '{"places": [[0, 0]], "neighbours": []}',
        '{"places": [[0, 0]], "neighbours": [[1]]}',
        '{"places": [[0]], "neighbours": [[]]}',
        '{"places": [["x", 0]], "neighbours": [[]]}',
    ],
)
def test_a_damaged_file_is_replaced(content: str) -> None:
    space = drawn(3)
    made = cached_roadmap(space)
    [file] = files()
    file.write_text(content)
    assert cached_roadmap(space).places == made.places
    assert len(json.loads(file.read_text())["places"]) == len(made.places)


def test_without_a_place_for_the_cache_roadmaps_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    space = drawn(4)
    assert cached_roadmap(space).places == roadmap_from_space(space).places


MAKE = """
import sys
sys.path.insert(0, sys.argv[1])
from test_roadmap_cache import drawn
from pioneer_traffic import roadmap_cache
make = roadmap_cache.roadmap_from_space
def said(*args):
    print("made", flush=True)
    return make(*args)
roadmap_cache.roadmap_from_space = said
roadmap_cache.cached_roadmap(drawn(5))
"""


def test_of_processes_that_need_the_same_one_at_once_one_makes_it() -> None:
    words = [sys.executable, "-c", MAKE, str(Path(__file__).parent)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    running = [
        subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    said = [process.communicate(timeout=60.0)[0] for process in running]
    assert [process.returncode for process in running] == [0] * 4
    assert sorted(said) == ["", "", "", "made\n"]


def test_a_process_that_hangs_while_it_makes_one_delays_the_others_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(roadmap_cache, "_PATIENCE", 0.3)
    space = drawn(5)
    made = cached_roadmap(space)
    [file] = files()
    file.unlink()
    began = time.monotonic()
    with roadmap_cache._alone(file.with_suffix(".lock")):
        assert cached_roadmap(space).places == made.places
    assert time.monotonic() - began >= 0.3
