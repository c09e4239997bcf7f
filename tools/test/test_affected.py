"""Which tests ``./pioneer test changed`` runs."""

import subprocess
from pathlib import Path

import pytest

from affected import ChangeError, affected, changed_files, modules_below


def written(folder: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Returns a folder with a package of three modules that import one another, and three tests."""
    sources = {
        "src/robot/__init__.py": "",
        "src/robot/pose.py": "",
        "src/robot/drive.py": "from robot import pose",
        "src/robot/node.py": "def main():\n    from robot.drive import Drive",
        "test/test_pose.py": "from robot.pose import Pose",
        "test/test_node.py": "import robot.node",
        "test/test_other.py": "import math",
    }
    written(tmp_path, sources)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "names"),
    [
        ("src/robot/pose.py", {"test_pose", "test_node"}),
        ("src/robot/drive.py", {"test_node"}),
        ("src/robot/__init__.py", {"test_pose", "test_node"}),
        ("test/test_other.py", {"test_other"}),
        ("README.md", set()),
    ],
)
def test_a_test_is_affected_by_what_it_imports_through_others(
    tree: Path, changed: str, names: set[str]
) -> None:
    tests = sorted((tree / "test").glob("*.py"))
    found = affected(tests, [tree / changed], modules_below([tree / "src"]))
    assert {path.stem for path in found} == names


def test_changed_files_are_those_since_a_commit_and_new_ones(tree: Path) -> None:
    def git(*words: str) -> None:
        author = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        subprocess.run(["git", "-C", str(tree), *author, *words], check=True, capture_output=True)

    git("init")
    git("add", ".")
    git("commit", "-m", "all")
    written(tree, {"src/robot/pose.py": "x = 1", "test/test_new.py": ""})
    assert changed_files(tree, "HEAD") == [tree / "src/robot/pose.py", tree / "test/test_new.py"]
    with pytest.raises(ChangeError, match="nowhere"):
        changed_files(tree, "nowhere")
