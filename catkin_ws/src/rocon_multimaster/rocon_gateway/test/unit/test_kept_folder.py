"""The folder whose files the hubs store."""

import json
import logging
from collections.abc import Callable
from pathlib import Path

import pytest

from rocon_gateway.hub.kept_folder import LARGEST, KeptFolder

LOGGER = logging.getLogger("rosout")


def test_files_go_from_one_computers_folder_to_anothers(tmp_path: Path) -> None:
    first, second = (KeptFolder(tmp_path / name, LOGGER) for name in ("a", "b"))
    assert first.text() == ""
    (tmp_path / "a" / "correction.json").write_text("{}\n")
    (tmp_path / "a" / ".correction.json.77").write_text("half")
    stored = first.text()
    assert stored
    assert second.restore(stored) == stored
    assert [one.name for one in (tmp_path / "b").iterdir()] == ["correction.json"]
    assert (tmp_path / "b" / "correction.json").read_text() == "{}\n"


def test_files_that_are_here_win_over_those_of_the_hub(tmp_path: Path) -> None:
    folder = KeptFolder(tmp_path, LOGGER)
    (tmp_path / "own").write_text("new")
    assert folder.restore(json.dumps({"own": "old", "other": "old"})) == json.dumps({"own": "new"})


@pytest.mark.parametrize(
    "name", ["../out", "/etc/passwd", "..", ".hidden", "a/b", "", "x" * 200, "a\n"]
)
def test_names_that_lead_elsewhere_are_not_written(tmp_path: Path, name: str) -> None:
    folder = KeptFolder(tmp_path / "in" / "kept", LOGGER)
    assert folder.restore(json.dumps({name: "text"})) == ""
    assert [str(one.relative_to(tmp_path)) for one in sorted(tmp_path.rglob("*"))] == [
        "in",
        "in/kept",
    ]


@pytest.mark.parametrize("text", ["{", "[]", "3", '{"a": 1}', "[" * 100_000, "x" * (LARGEST + 1)])
def test_what_another_client_wrote_in_its_place_is_left_out(tmp_path: Path, text: str) -> None:
    assert KeptFolder(tmp_path, LOGGER).restore(text) == ""
    assert not list(tmp_path.iterdir())


def test_too_much_is_not_kept_and_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = KeptFolder(tmp_path, LOGGER)
    (tmp_path / "large").write_text("x" * LARGEST)
    with caplog.at_level(logging.WARNING, "rosout"):
        assert [folder.text(), folder.text()] == [None, None]
    assert caplog.text.count("not kept by the hub: more than") == 1


def _make_not_utf8(folder: Path) -> None:
    (folder / "own").write_bytes(b"\xff\xfe")


def _make_sub_folder(folder: Path) -> None:
    (folder / "own").mkdir()


def _make_large(folder: Path) -> None:
    (folder / "own").write_text("x" * LARGEST)


@pytest.mark.parametrize("spoil", [_make_not_utf8, _make_sub_folder, _make_large])
def test_a_folder_that_cannot_be_kept_is_not_overwritten_with_the_hubs_old_copy(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    folder = KeptFolder(tmp_path, LOGGER)
    (tmp_path / "waypoints").write_text("new")
    spoil(tmp_path)
    old = json.dumps({"waypoints": "old", "own": "old"})
    assert folder.restore(old) == old  # the hub's copy stays too
    assert folder.text() is None
    assert (tmp_path / "waypoints").read_text() == "new"
    assert not (tmp_path / "own").is_file() or (tmp_path / "own").read_bytes() != b"old"


def test_the_hubs_copy_stays_while_it_cannot_be_written(tmp_path: Path) -> None:
    folder = KeptFolder(tmp_path, LOGGER)
    (tmp_path / ".second").mkdir()  # where the second file would be written
    kept = json.dumps({"first": "1", "second": "2"})
    assert folder.restore(kept) == kept
    assert [one.name for one in tmp_path.iterdir()] == [".second"]
    assert folder.text() is None
    (tmp_path / ".second").rmdir()
    assert folder.restore(kept) == kept
    assert (tmp_path / "second").read_text() == "2"
