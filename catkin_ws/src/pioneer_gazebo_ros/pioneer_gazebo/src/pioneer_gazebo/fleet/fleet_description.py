"""Gives a robot's description the topics and frames by which a fleet knows its robots.

Descriptions of other makes name their topics as their makers like. In a fleet all robots are commanded, read and
localised by the same names, so plugins are renamed before the robot is spawned. What was renamed is said.
"""

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.pose import Pose

COMMAND, ODOMETRY, SCAN = "pioneer/cmd_vel", "odom", "base_scan"
TRUTH = "base_pose_ground_truth"
ODOMETRY_FRAME, BASE = "odom", "base_link"

_KOBUKI = "gazebo_ros_kobuki"
_DRIVES = (
    "gazebo_ros_diff_drive",
    "gazebo_ros_skid_steer_drive",
    "gazebo_ros_planar_move",
    "gazebo_ros_force_based_move",
    _KOBUKI,
)
_LASERS = ("gazebo_ros_laser", "gazebo_ros_gpu_laser", "gazebo_ros_block_laser")
_TRUTH = "gazebo_ros_p3d"
_JOINT_STATES = "gazebo_ros_joint_state_publisher"
XACRO_PATIENCE = 60.0
"""Longest time that xacro may take [s]."""

_RATE = "20"
"""Rate of added plugins [Hz]."""


@dataclass
class FleetDescription:
    """A robot's description in URDF with the fleet's names, and a line about each change."""

    text: str
    changes: list[str] = field(default_factory=list)


def fleet_description(urdf: str, scan: str = SCAN) -> FleetDescription:
    """Returns a description whose drive and laser have the fleet's topics and frames.

    Args:
        urdf: the description.
        scan: topic of the laser that navigation uses.

    Raises:
        DescriptionError: it is not XML, or a joint between its root and `BASE` has no valid origin.
    """
    try:
        root = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise DescriptionError(f"the description is not XML: {error}") from None
    changes: list[str] = []
    _make_relative(root)
    base = _root_at_base(root)
    _name_drive(root, base, changes)
    _name_laser(root, scan, changes)
    _add_reports(root)
    return FleetDescription(ElementTree.tostring(root, encoding="unicode"), changes)


def expanded(path: Path) -> str:
    """Returns the URDF of a URDF or xacro file.

    Raises:
        DescriptionError: xacro refuses it, with the reason, does not end, or is not there.
    """
    command = ["xacro", str(path)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=XACRO_PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise DescriptionError(f"xacro {path} did not end within {XACRO_PATIENCE:g} s") from None
    except OSError as error:
        raise DescriptionError(f"xacro cannot be run: {error.strerror}") from None
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no reason was given"]
        # The lines after it say where.
        reason = next((line for line in lines if "error" in line.lower()), lines[0])
        raise DescriptionError(f"xacro {path} failed: {reason}")
    return done.stdout


def _plugins(root: Element, *libraries: str) -> Iterator[Element]:
    """Yields the plugins of these libraries; all plugins if none is given."""
    for plugin in root.iter("plugin"):
        if not libraries or _library(plugin) in libraries:
            yield plugin


def _library(plugin: Element) -> str:
    """Returns the name of a plugin's library without folder, ``lib`` and ``.so``."""
    file = plugin.get("filename", "").rpartition("/")[2]
    return file.removeprefix("lib").removesuffix(".so")


def _make_relative(root: Element) -> None:
    """Puts all topics into the robot's namespace, so that robots of one make do not share them."""
    for plugin in _plugins(root):
        for child in list(plugin):
            if child.tag == "robotNamespace":
                plugin.remove(child)
            elif child.tag.lower().endswith(("topic", "topicname")):
                child.text = (child.text or "").strip().lstrip("/")


def _name_drive(root: Element, base: str, changes: list[str]) -> None:
    drives = list(_plugins(root, *_DRIVES))
    if not drives:
        changes.append(
            "it has no plugin that drives it by a topic of its own "
            f"({', '.join(f'lib{name}.so' for name in _DRIVES)}): the fleet cannot command it"
        )
        return
    drive = drives[0]
    is_kobuki = _library(drive) == _KOBUKI
    command = "mobile_base/commands/velocity" if is_kobuki else "cmd_vel"
    _rename(drive, "commandTopic", COMMAND, command, changes)
    _rename(drive, "odometryTopic", ODOMETRY, "odom", changes)
    _rename(drive, "odometryFrame", ODOMETRY_FRAME, "odom", changes)
    _rename(drive, "robotBaseFrame", base, "base_footprint", changes)
    for tag in ("publishTf", "publishOdomTF", "publishOdometryTf", "broadcastTF"):
        if drive.findtext(tag, "true").strip().lower() in ("false", "0"):
            _rename(drive, tag, "true", "true", changes)
    if is_kobuki and drive.findtext("publish_tf", "0").strip().lower() in ("false", "0"):
        _rename(drive, "publish_tf", "true", "false", changes)


def _name_laser(root: Element, scan: str, changes: list[str]) -> None:
    lasers = list(_plugins(root, *_LASERS))
    if not lasers:
        changes.append("it has no laser: it cannot navigate")
    elif all((laser.findtext("topicName") or SCAN).strip() != scan for laser in lasers):
        _rename(lasers[0], "topicName", scan, SCAN, changes)


def _rename(plugin: Element, tag: str, wanted: str, default: str, changes: list[str]) -> None:
    """Sets an element of a plugin, which without it has the value ``default``."""
    child = plugin.find(tag)
    was = default if child is None else (child.text or "").strip()
    if was == wanted:
        return
    if child is None:
        child = SubElement(plugin, tag)
    child.text = wanted
    changes.append(f"{tag} {was!r} is {wanted!r} in the fleet")


def _root_at_base(root: Element) -> str:
    """Makes `BASE` the root of the tree of links; returns the root's name.

    Odometry moves the root, and all who look at a fleet expect ``odom`` to be right above ``base_link``. A robot
    without such a link gets one where its root is. If joints that move lie in between, the root stays.
    """
    above = {_linked(joint, "child"): joint for joint in root.findall("joint")}
    names = [link.get("name", "") for link in root.findall("link")]
    top = next((name for name in names if name not in above), "")
    if BASE not in names:
        SubElement(root, "link", name=BASE)
        joint = SubElement(root, "joint", name=f"fleet_{BASE}_joint", type="fixed")
        SubElement(joint, "parent", link=BASE)
        SubElement(joint, "child", link=top)
        return BASE
    chain: list[Element] = []
    link = BASE
    # A loop of joints is refused when the robot is read.
    while link in above and len(chain) < len(names):
        chain.append(above[link])
        link = _linked(above[link], "parent")
    if any(joint.get("type") != "fixed" for joint in chain):
        return top
    for joint in chain:
        _reverse(joint)
    return BASE


def _linked(joint: Element, end: str) -> str:
    """Returns the name of a joint's ``parent`` or ``child``."""
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _reverse(joint: Element) -> None:
    """Swaps the links that a fixed joint connects; both stay where they are."""
    parent, child = _linked(joint, "parent"), _linked(joint, "child")
    origin = joint.find("origin")
    if origin is None:
        origin = SubElement(joint, "origin")
    try:
        x, y, z = map(float, origin.get("xyz", "0 0 0").split())
        roll, pitch, yaw = map(float, origin.get("rpy", "0 0 0").split())
    except ValueError:
        raise DescriptionError(
            f"joint {joint.get('name')}: xyz and rpy of its origin need three numbers each"
        ) from None
    back = Pose.from_rpy(x, y, z, roll, pitch, yaw).inverse()
    origin.set("xyz", " ".join(map(repr, back.position)))
    origin.set("rpy", " ".join(map(repr, back.rpy())))
    for end, link in (("parent", child), ("child", parent)):
        found = joint.find(end)
        if found is not None:
            found.set("link", link)


def _add_reports(root: Element) -> None:
    """Adds the plugins that report the true pose and the joints, if there are none."""
    truths = _plugins(root, _TRUTH)
    if all(truth.findtext("topicName") != TRUTH for truth in truths):
        _add_plugin(root, _TRUTH, bodyName=BASE, topicName=TRUTH, frameName="map")
    if not any(_plugins(root, _JOINT_STATES)):
        _add_plugin(root, _JOINT_STATES)


def _add_plugin(root: Element, library: str, **elements: str) -> None:
    holder = SubElement(root, "gazebo")
    plugin = SubElement(holder, "plugin", name=f"fleet_{library}", filename=f"lib{library}.so")
    for tag, text in {**elements, "updateRate": _RATE}.items():
        SubElement(plugin, tag).text = text
