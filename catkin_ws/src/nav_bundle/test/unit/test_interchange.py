"""One launch argument starts the C++ navigation stack in place of our nodes.

Debian does not package that stack, so the tests use folders with empty executables of the same names.
"""

import contextlib
import io
from pathlib import Path

import pytest
import roslaunch.config
import roslaunch.core
import roslaunch.xmlloader
import roslib.packages
import rospkg

LAUNCH = Path(__file__).parents[2] / "launch"
CPP = {
    "amcl": "amcl",
    "map_server": "map_server",
    "move_base": "move_base",
    "gmapping": "slam_gmapping",
}
NAVIGATION = set(CPP.values())
FILES = {
    "map_server.launch": {"map_server"},
    "amcl_pioneer.launch": {"amcl"},
    "amcl_no_namespace.launch": {"amcl"},
    "localisation_launcher.launch": {"amcl"},
    "single_navigation.launch": {"amcl", "move_base"},
    "multi_navigation.launch": {"amcl", "move_base"},
    "nav_bundle.launch": {"slam_gmapping", "move_base"},
}


@pytest.fixture
def packages(tmp_path: Path) -> rospkg.RosPack:
    """Returns a RosPack that finds only the C++ packages."""
    for package, executable in CPP.items():
        folder = tmp_path / package
        folder.mkdir()
        (folder / "package.xml").write_text(f"<package><name>{package}</name></package>")
        (folder / executable).touch(0o755)
    return rospkg.RosPack([str(tmp_path)])


def navigation_nodes(file: str, *arguments: str) -> list[tuple[str, str]]:
    """Returns (package, type) of the navigation nodes that a launch file starts."""
    return [(node.package, node.type) for node in launched(file, *arguments)]


def launched(file: str, *arguments: str) -> list[roslaunch.core.Node]:
    """Returns the navigation nodes that a launch file starts."""
    return [node for node in every_node(file, *arguments) if node.type in NAVIGATION]


def every_node(file: str, *arguments: str) -> list[roslaunch.core.Node]:
    """Returns all nodes that a launch file starts."""
    config = roslaunch.config.ROSLaunchConfig()
    with contextlib.redirect_stdout(io.StringIO()):
        roslaunch.xmlloader.XmlLoader(resolve_anon=False).load(
            str(LAUNCH / file), config, argv=["robot_name:=pioneer1", *arguments], verbose=False
        )
    return list(config.nodes)


pytestmark = pytest.mark.filterwarnings("default")


@pytest.mark.parametrize("file", FILES)
def test_one_argument_starts_the_cpp_nodes(file: str, packages: rospkg.RosPack) -> None:
    nodes = navigation_nodes(file, "nav_pkg:=navigation")
    assert {kind for _, kind in nodes} == FILES[file]
    for package, kind in nodes:
        assert roslib.packages.find_node(package, kind, packages), f"{package}/{kind}"


@pytest.mark.parametrize("file", FILES)
def test_without_it_all_nodes_are_ours(file: str) -> None:
    assert {package for package, _ in navigation_nodes(file)} == {"nav_bundle"}


def test_localisation_and_navigation_start_again_when_they_die() -> None:
    assert {node.type for node in launched("single_navigation.launch") if node.respawn} == {
        "amcl",
        "move_base",
    }


def test_slam_alone_starts_gmapping(packages: rospkg.RosPack) -> None:
    for package in ("navigation", "gmapping"):
        assert navigation_nodes("single_slam.launch", f"slam_pkg:={package}") == [
            ("gmapping", "slam_gmapping")
        ]


def test_nodes_of_both_can_be_mixed() -> None:
    nodes = navigation_nodes("single_navigation.launch", "amcl_pkg:=amcl")
    assert nodes == [("amcl", "amcl"), ("nav_bundle", "move_base")]
    nodes = navigation_nodes(
        "single_navigation.launch", "nav_pkg:=navigation", "amcl_pkg:=nav_bundle"
    )
    assert nodes == [("nav_bundle", "amcl"), ("move_base", "move_base")]


@pytest.mark.parametrize("traffic", ["false", "true"])
def test_without_navigation_only_the_velocity_controller_is_left(traffic: str) -> None:
    arguments = ("navigation:=none", f"traffic:={traffic}")
    nodes = every_node("single_navigation.launch", *arguments)
    assert [node.name for node in nodes] == ["pioneer_ros"]
