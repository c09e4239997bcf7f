"""Finds code outside ``pioneer_launch`` that uses or replaces private parts of ROS's Python packages.

``python3 tools/ros_private.py [FILE …]`` prints them, a line each, and fails if there are any. Private are names with a
leading underscore, ``rospy.impl``, and the modules in which roslaunch and rosmaster do their work. To replace is to
assign to an attribute of a ROS module or of one of its classes.
"""

import ast
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = frozenset(
    (
        "actionlib",
        "dynamic_reconfigure",
        "genpy",
        "rosgraph",
        "roslaunch",
        "roslib",
        "rosmaster",
        "rosparam",
        "rospkg",
        "rospy",
        "tf2_py",
        "tf2_ros",
    )
)
PRIVATE_MODULES = (
    "rospy.impl",
    "roslaunch.loader",
    "roslaunch.nodeprocess",
    "rosmaster.master_api",
    "rosmaster.threadpool",
    "rosmaster.util",
)
_FENCE = "pioneer_launch"


def findings(path: Path) -> Iterator[str]:
    """Yields ``path:line: what`` for each private name that the Python file uses or replaces."""
    names: dict[str, str] = {}
    tree = ast.parse(path.read_text(), str(path))
    for node in ast.walk(tree):
        for full_name, line in _imported(node, names):
            if _is_private(full_name):
                yield f"{path}:{line}: {full_name} is private to ROS"
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute):
            continue
        full_name = _full_name(node, names)
        if isinstance(node.ctx, ast.Store | ast.Del) and full_name:
            yield f"{path}:{node.lineno}: replaces {full_name}"
        elif _is_private(full_name) and not _is_private(_full_name(node.value, names)):
            yield f"{path}:{node.lineno}: {full_name} is private to ROS"


def _imported(node: ast.AST, names: dict[str, str]) -> Iterator[tuple[str, int]]:
    """Notes the local names of a ROS import in ``names``; yields the full names with their lines."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            package = alias.name.partition(".")[0]
            if package in PACKAGES:
                names[alias.asname or package] = alias.name if alias.asname else package
                yield alias.name, node.lineno
    elif isinstance(node, ast.ImportFrom) and not node.level:
        module = node.module or ""
        if module.partition(".")[0] in PACKAGES:
            for alias in node.names:
                names[alias.asname or alias.name] = f"{module}.{alias.name}"
                yield f"{module}.{alias.name}", node.lineno


def _full_name(node: ast.expr, names: dict[str, str]) -> str:
    """Returns the dotted name of an attribute of something imported from ROS; empty for anything else."""
    if isinstance(node, ast.Name):
        return names.get(node.id, "")
    if isinstance(node, ast.Attribute):
        owner = _full_name(node.value, names)
        return f"{owner}.{node.attr}" if owner else ""
    return ""


def _is_private(full_name: str) -> bool:
    has_underscore = any(
        part.startswith("_") and not part.startswith("__") for part in full_name.split(".")
    )
    return has_underscore or any(
        f"{full_name}.".startswith(f"{module}.") for module in PRIVATE_MODULES
    )


def sources() -> Iterator[Path]:
    """Yields the workspace's Python sources, without tests and without ``pioneer_launch``."""
    for path in sorted((ROOT / "catkin_ws" / "src").glob("**/src/**/*.py")):
        if _FENCE not in path.parts and "test" not in path.parts:
            yield path
    yield from sorted((ROOT / "tools").glob("**/*.py"))


def main(paths: Iterable[str]) -> int:
    """Checks these files, or all; returns 1 if anything was found."""
    files = [Path(path) for path in paths] or list(sources())
    found = [finding for path in files for finding in findings(path)]
    sys.stdout.writelines(f"{finding}\n" for finding in found)
    return bool(found)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
