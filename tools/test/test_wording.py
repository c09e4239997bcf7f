"""Words that readers stumble over are rejected in every text."""

from pathlib import Path

from text_check import stumbles


def test_a_listed_word_is_named_with_what_to_write(tmp_path: Path) -> None:
    text = tmp_path / "text.md"
    text.write_text("It waits.\nAfter 90 s it waited IN\u0020VAIN.\n")
    assert list(stumbles([text])) == [
        f"{text}:2: 'IN\u0020VAIN'; write: timed out after 90 s waiting for X"
    ]


def test_pictures_are_no_text(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\xff\xfe \x61new")
    assert list(stumbles([picture])) == []
