"""Every launch file loads, everything that it starts exists, and each of its arguments is explained.

Files are found by directory, not listed. For a file that has arguments without a default, the package's
``test/launch_args.yaml`` gives values: ``{file.launch: {argument: value}}``.
"""

import contextlib
import importlib.util
import io
import os
import re
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import roslaunch.config
import roslaunch.xmlloader
import roslib.packages
import yaml

WORKSPACE = Path(__file__).resolve().parents[2] / "catkin_ws"
SOURCE = WORKSPACE / "src"
LAUNCH_FILES = sorted(path for path in SOURCE.rglob("launch/**/*.launch"))
# Packages outside this workspace that a user may have installed and that our launch files can start instead.
FOREIGN_NODES = {("rviz", "rviz")}


def package_of(path: Path) -> Path:
    return next(parent for parent in path.parents if (parent / "package.xml").exists())


NAMES = [f"{package_of(path).name}/{path.name}" for path in LAUNCH_FILES]


def arguments_for(path: Path) -> list[str]:
    table = package_of(path) / "test" / "launch_args.yaml"
    values = (yaml.safe_load(table.read_text()) or {}).get(path.name, {}) if table.exists() else {}
    return [f"{name}:={value}" for name, value in values.items()]


@pytest.fixture(scope="module")
def plain_terminal() -> dict[str, str]:
    """Returns the environment of a terminal in which only ``source catkin_ws/devel/setup.bash`` was typed."""
    bare = {"HOME": os.environ.get("HOME", "/"), "PATH": "/usr/local/bin:/usr/bin:/bin"}
    command = ["bash", "--norc", "-c", 'source "$0"/devel/setup.bash && env -0', str(WORKSPACE)]
    output = subprocess.run(
        command, env=bare, check=True, capture_output=True, text=True, timeout=60
    ).stdout
    return dict(line.split("=", 1) for line in output.split("\0") if line)


@pytest.fixture(autouse=True)
def a_robot_computer(monkeypatch: pytest.MonkeyPatch, plain_terminal: dict[str, str]) -> None:
    monkeypatch.setenv("PATH", plain_terminal["PATH"])
    monkeypatch.setenv("HOSTNAME", "aadi1")


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", LAUNCH_FILES, ids=NAMES)
def test_launch_file_loads_and_names_only_executables_that_exist(path: Path) -> None:
    config = roslaunch.config.ROSLaunchConfig()
    loader = roslaunch.xmlloader.XmlLoader(resolve_anon=False)
    with contextlib.redirect_stdout(io.StringIO()):
        loader.load(str(path), config, argv=arguments_for(path), verbose=False)
    assert not config.config_errors
    for node in config.nodes:
        if (node.package, node.type) not in FOREIGN_NODES:
            assert roslib.packages.find_node(node.package, node.type), (
                f"no executable {node.package}/{node.type}"
            )


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=NAMES)
def test_each_argument_of_a_launch_file_is_explained(path: Path) -> None:
    elements = ElementTree.parse(path).getroot().findall("arg")
    unexplained = [
        element.get("name")
        for element in elements
        if not ("value" in element.attrib or element.get("doc"))
    ]
    assert not unexplained, f"arguments without doc=: {unexplained}"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=NAMES)
def test_each_argument_of_a_launch_file_is_used_or_says_that_it_changes_nothing(path: Path) -> None:
    root, text = ElementTree.parse(path).getroot(), path.read_text()
    passed_on = any(element.get("pass_all_args") == "true" for element in root.iter("include"))
    declared = {element.get("name"): element.get("doc", "") for element in root.findall("arg")}
    unused = [
        name
        for name, doc in declared.items()
        if not (
            passed_on
            or f"$(arg {name})" in text
            or f"arg('{name}')" in text
            or "changes nothing" in doc
        )
    ]
    assert not unused, f"arguments that nothing uses: {unused}"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=NAMES)
def test_what_is_handed_to_an_included_file_has_a_value(path: Path) -> None:
    handed = [
        one
        for include in ElementTree.parse(path).getroot().iter("include")
        for one in include.findall("arg")
    ]
    assert not [one.get("name") for one in handed if "value" not in one.attrib]


def test_a_terminal_that_sourced_the_workspace_gets_its_commands_and_no_other_python(
    plain_terminal: dict[str, str],
) -> None:
    found = subprocess.run(
        ["bash", "--norc", "-c", "type -P python3 xacro rocon_launch"],
        env=plain_terminal, check=True, capture_output=True, text=True, timeout=60,
    ).stdout.split()  # fmt: skip
    commands = WORKSPACE / "devel" / "bin"
    assert found == ["/usr/bin/python3", str(commands / "xacro"), str(commands / "rocon_launch")]


def test_executables_carry_an_interpreter_that_has_their_modules() -> None:
    wrong = {
        str(path): line
        for path in (WORKSPACE / "devel").glob("lib/*/*")
        if path.is_file() and os.access(path, os.X_OK)
        for line in path.read_bytes().splitlines()[:1]
        if line.startswith(b"#!") and b"python" in line and b"/.setup/venv/bin/python3" not in line
    }
    assert not wrong


@pytest.mark.parametrize(
    ("package", "path"),
    [
        ("pioneer_description", "launch/one_pioneer.launch"),
        ("pioneer_description", "launch/pioneer_poses.yaml"),
        ("pioneer_2dnav", "base_local_planner_params.yaml"),
        ("pioneer_2dnav", "costmap_common_params.yaml"),
        ("pioneer_2dnav", "global_costmap_params.yaml"),
        ("pioneer_2dnav", "local_costmap_params.yaml"),
        ("pioneer_ros", "pioneer_controller_params.yaml"),
    ],
)
def test_files_of_the_original_are_where_its_launch_files_look(package: str, path: str) -> None:
    assert (Path(roslib.packages.get_pkg_dir(package)) / path).read_text()


@pytest.mark.parametrize(
    ("package", "name"),
    [
        ("rocon_flip", "original_msg_publisher"),
        ("rocon_flip", "msg_receiver"),
        ("simple_navigation_goals", "move_base_recover"),
    ],
)
def test_executables_of_the_original_exist(package: str, name: str) -> None:
    assert roslib.packages.find_node(package, name)


def test_every_program_is_a_function_of_a_module_that_exists() -> None:
    built = {path: path.read_text() for path in SOURCE.parent.glob("build/**/programs/*")}
    called = [re.search(r'imported\("([\w.]+)"\)\.(\w+)\(\)', text) for text in built.values()]
    assert len(called) > 50
    missing = [found for found in called if found is None or not _defines(found[1], found[2])]
    assert not missing


def _defines(module: str, function: str) -> bool:
    spec = importlib.util.find_spec(module)
    return (
        spec is not None
        and spec.origin is not None
        and f"def {function}(" in Path(spec.origin).read_text()
    )


@pytest.mark.parametrize("config", ["pioneer", "pioneer.rviz", "/tmp/my own.rviz"])
def test_an_rviz_configuration_is_a_name_or_a_file(config: str) -> None:
    path = SOURCE / "pioneer_gazebo_ros" / "pioneer_description" / "launch" / "pioneer_rviz.launch"
    loaded = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader(resolve_anon=False).load(
        str(path), loaded, argv=[f"rviz_config:={config}"], verbose=False
    )
    expected = config if "/" in config else f"{path.parents[1]}/rviz/pioneer.rviz"
    assert loaded.nodes[0].args == f"-d '{expected}'"


def test_there_are_launch_files() -> None:
    assert LAUNCH_FILES
