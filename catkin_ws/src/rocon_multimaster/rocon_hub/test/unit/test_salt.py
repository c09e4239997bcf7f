"""The fleet's salt."""

from pathlib import Path

import pytest

from rocon_hub.salt import SaltFile


def test_a_salt_outlives_restarts_but_not_its_password(tmp_path: Path) -> None:
    """It once survived a change of password, so that former members knew it."""
    path = tmp_path / "salt"
    first = SaltFile(path).get("open sesame")
    assert SaltFile(path).get("open sesame") == first
    second = SaltFile(path).get("open barley")
    assert second != first
    assert SaltFile(path).get("open barley") == second
    assert path.stat().st_mode & 0o777 == 0o600
    assert "open" not in path.read_text()


@pytest.mark.parametrize("content", [b"", b"abc", b"abc def", b"\xff\xfe x", b"a b c\n"])
def test_a_file_that_is_no_salt_is_replaced(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "salt"
    path.write_bytes(content)
    assert SaltFile(path).get("open sesame") == SaltFile(path).get("open sesame")


def test_a_salt_that_cannot_be_stored_is_used_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert SaltFile(tmp_path / "none" / "salt").get("open sesame")
    assert "cannot be stored" in caplog.text
