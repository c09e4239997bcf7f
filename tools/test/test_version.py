"""All packages have the same version."""

from pathlib import Path

from text_check import ROOT, other_versions


def test_all_packages_have_the_version() -> None:
    assert other_versions(ROOT) == []


def test_a_package_of_another_version_is_named(tmp_path: Path) -> None:
    package = tmp_path / "catkin_ws" / "src" / "one"
    package.mkdir(parents=True)
    (tmp_path / "VERSION").write_text("1.2.0\n")
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## Unreleased\n\n## 1.2.0 - 2026-01-01\n"
    )
    (package / "package.xml").write_text("<package><version>1.1.0</version></package>")
    assert other_versions(tmp_path) == [
        "catkin_ws/src/one/package.xml: version 1.1.0, VERSION says 1.2.0"
    ]
