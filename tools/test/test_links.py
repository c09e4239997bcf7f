"""The documentation has no broken links."""

from pathlib import Path

from text_check import anchors, broken_links


def test_a_link_to_a_missing_file_or_heading_is_named(tmp_path: Path) -> None:
    (tmp_path / "one.md").write_text(
        "# The `Top` of it\n[a](two.md) [b](#the-top-of-it) [c](#no) [d](https://x.org)\n"
    )
    assert list(broken_links(tmp_path, ["one.md"])) == ["one.md: two.md", "one.md: #no"]


def test_code_blocks_hold_no_links(tmp_path: Path) -> None:
    (tmp_path / "one.md").write_text("```\n[a](two.md)\n```\n")
    assert list(broken_links(tmp_path, ["one.md"])) == []


def test_equal_headings_have_numbered_anchors() -> None:
    assert anchors("# Use\n## Use\n") == {"use", "use-1"}
