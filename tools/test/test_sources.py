"""Text checks read the project's own files, with or without git."""

from text_check import ROOT, project_files


def test_sources_are_found_and_what_set_up_made_is_not() -> None:
    found = {str(path.relative_to(ROOT)) for path in project_files()}
    assert {
        "README.md",
        ".gitignore",
        "docker/wheels/.gitignore",
        "tools/test/test_sources.py",
    } <= found
    assert not [
        name for name in found if name.startswith((".git/", ".setup/")) or name.endswith(".pyc")
    ]
