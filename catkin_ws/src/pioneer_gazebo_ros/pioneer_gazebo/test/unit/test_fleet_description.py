"""Robots of other makes get the fleet's topics and frames, and move_base a footprint from their shapes."""

import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from pioneer_gazebo.body.body import body_from_robot
from pioneer_gazebo.commands import spawn_model
from pioneer_gazebo.error import DescriptionError, SpawnError
from pioneer_gazebo.fleet import run_navigation
from pioneer_gazebo.fleet.fleet_description import expanded, fleet_description
from pioneer_gazebo.fleet.footprint import footprint
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.robot import DiffDrive, GroundTruth, JointStatePublisher, PlanarMove
from pioneer_gazebo.world.urdf import robot_from_urdf
from pioneer_node.core.fleet_file import RobotEntry

BURGER = (Path(__file__).parent / "burger_like.urdf").read_text()
PIONEER = (Path(__file__).parent / "pioneer.urdf").read_text()


def test_a_robot_of_another_make_gets_the_fleets_names_and_each_change_is_said():
    described = fleet_description(BURGER)
    robot = robot_from_urdf(described.text)
    [drive] = robot.drives
    assert (drive.commandTopic, drive.odometryTopic) == ("pioneer/cmd_vel", "odom")
    assert (drive.odometryFrame, drive.robotBaseFrame) == ("odom", "base_link")
    [laser] = robot.lasers
    assert (laser.topic, laser.frame) == ("base_scan", "base_scan")
    [truth] = robot.of(GroundTruth)
    assert (truth.topicName, truth.bodyName) == ("base_pose_ground_truth", "base_link")
    assert len(robot.of(JointStatePublisher)) == 1
    assert described.changes == [
        "commandTopic 'cmd_vel' is 'pioneer/cmd_vel' in the fleet",
        "odometryTopic 'wheel_odom' is 'odom' in the fleet",
        "odometryFrame 'odom_combined' is 'odom' in the fleet",
        "topicName 'scan' is 'base_scan' in the fleet",
    ]


def test_a_description_with_the_fleets_names_is_left_as_it_is():
    described = fleet_description(fleet_description(BURGER).text)
    assert described.changes == []
    assert robot_from_urdf(described.text) == robot_from_urdf(fleet_description(BURGER).text)


def test_the_laser_that_the_fleet_file_names_keeps_its_topic():
    described = fleet_description(BURGER, "scan")
    assert robot_from_urdf(described.text).lasers[0].topic == "scan"
    assert not any("topicName" in change for change in described.changes)


def test_a_laser_without_a_topic_has_the_fleets_already():
    described = fleet_description(BURGER.replace("<topicName>/scan</topicName>", ""))
    assert robot_from_urdf(described.text).lasers[0].topic == "base_scan"
    assert not any("topicName" in change for change in described.changes)


def test_only_the_first_of_two_lasers_is_renamed_and_none_if_one_has_the_name():
    sensor = BURGER[BURGER.index('  <gazebo reference="base_scan">') : BURGER.index("  <gazebo>\n")]
    rear = sensor.replace("/scan<", "/rear<").replace('"lds"', '"rear"')
    two = BURGER.replace("  <gazebo>\n", rear + "  <gazebo>\n", 1)
    topics = [laser.topic for laser in robot_from_urdf(fleet_description(two).text).lasers]
    assert topics == ["base_scan", "rear"]
    topics = [laser.topic for laser in robot_from_urdf(fleet_description(two, "rear").text).lasers]
    assert topics == ["scan", "rear"]


def test_base_link_becomes_the_root_and_every_link_stays_where_it_is():
    turned = BURGER.replace(
        '<origin xyz="0 0 0.01"/>', '<origin xyz="0.1 -0.2 0.01" rpy="0.1 0.2 0.7"/>'
    )
    before, after = robot_from_urdf(turned), robot_from_urdf(fleet_description(turned).text)
    assert (before.root.name, after.root.name) == ("base_footprint", "base_link")
    for link in ("base_footprint", "base_scan", "caster_link", "wheel_left_link"):
        was, now = place(before, link), place(after, link)
        assert now.position == pytest.approx(was.position, abs=1e-9)
        assert np.abs(np.dot(now.rotation, was.rotation)) == pytest.approx(1.0)


def place(robot, link):
    """Returns a link's pose in base_link, with all joints at 0."""
    body = body_from_robot(robot, triangles_of_mesh)
    frames = body.frames()
    found = []
    for name in ("base_link", link):
        part, at = body.part_of(name)
        found.append(frames[part].compose(at))
    base, other = found
    return base.inverse().compose(other)


def test_a_robot_without_base_link_gets_one_at_its_root():
    described = fleet_description(BURGER.replace('"base_link"', '"chassis"'))
    robot = robot_from_urdf(described.text)
    assert robot.root.name == robot.drives[0].robotBaseFrame == "base_link"
    assert place(robot, "base_footprint").position == (0.0, 0.0, 0.0)


def test_a_base_that_moves_on_the_root_leaves_the_root_where_it_is():
    moving = BURGER.replace('name="base_joint" type="fixed"', 'name="base_joint" type="prismatic"')
    moving = moving.replace(
        '<child link="base_link"/></joint>',
        '<child link="base_link"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>',
    )
    robot = robot_from_urdf(fleet_description(moving).text)
    assert robot.root.name == robot.drives[0].robotBaseFrame == "base_footprint"


def test_planar_and_skid_steer_drives_are_renamed_too():
    start, end = BURGER.index('    <plugin name="controller"'), BURGER.rindex("  </gazebo>")
    planar = '<plugin name="p" filename="libgazebo_ros_planar_move.so"/>'
    robot = robot_from_urdf(fleet_description(BURGER[:start] + planar + BURGER[end:]).text)
    [mover] = robot.of(PlanarMove)
    assert (mover.commandTopic, mover.odometryTopic) == ("pioneer/cmd_vel", "odom")
    skid = BURGER.replace("gazebo_ros_diff_drive", "gazebo_ros_skid_steer_drive")
    for side in ("left", "right"):
        joint = f"<{side}Joint>wheel_{side}_joint</{side}Joint>"
        both = "".join(
            f"<{side}{end}Joint>wheel_{side}_joint</{side}{end}Joint>" for end in ("Front", "Rear")
        )
        skid = skid.replace(joint, both)
    [drive] = robot_from_urdf(fleet_description(skid).text).of(DiffDrive)
    assert (drive.commandTopic, drive.odometryTopic) == ("pioneer/cmd_vel", "odom")


def test_a_kobuki_joins_with_the_fleets_names():
    start, end = BURGER.index('    <plugin name="controller"'), BURGER.rindex("  </gazebo>")
    plugin = """<plugin name="k" filename="libgazebo_ros_kobuki.so"><wheel_separation>0.26</wheel_separation>
<left_wheel_joint_name>wheel_left_joint</left_wheel_joint_name><wheel_diameter>0.1</wheel_diameter>
<right_wheel_joint_name>wheel_right_joint</right_wheel_joint_name><torque>5</torque></plugin>"""
    described = fleet_description(BURGER[:start] + plugin + BURGER[end:])
    [drive] = robot_from_urdf(described.text).drives
    assert (drive.commandTopic, drive.robotBaseFrame) == ("pioneer/cmd_vel", "base_link")
    assert drive.publishTf
    changed = "commandTopic 'mobile_base/commands/velocity' is 'pioneer/cmd_vel' in the fleet"
    assert changed in described.changes


def test_odometry_that_is_kept_from_tf_is_there_in_the_fleet():
    drive = "<odometrySource>encoder</odometrySource>"
    described = fleet_description(BURGER.replace(drive, f"{drive}<publishTf>false</publishTf>"))
    assert robot_from_urdf(described.text).drives[0].publishTf
    assert "publishTf 'false' is 'true' in the fleet" in described.changes


@pytest.mark.parametrize(
    ("cut", "words"),
    [("libgazebo_ros_diff_drive.so", "cannot command it"), ("libgazebo_ros_laser.so", "no laser")],
)
def test_a_robot_that_the_fleet_cannot_drive_is_named(cut, words):
    changes = fleet_description(BURGER.replace(cut, "libother.so")).changes
    assert any(words in change for change in changes)


def test_what_is_no_xml_is_refused_in_one_line():
    with pytest.raises(DescriptionError, match="not XML"):
        fleet_description("<robot")


def test_an_origin_without_three_numbers_is_named():
    with pytest.raises(DescriptionError, match=r"base_joint.*three numbers"):
        fleet_description(BURGER.replace('xyz="0 0 0.01"', 'xyz="0 0"', 1))


def contains(corners, points):
    """Returns whether a convex polygon, its corners counter-clockwise, contains all points, to a millimetre."""
    a = np.array(corners)
    b = np.roll(a, -1, axis=0)
    for x, y in points:
        across = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])
        if (across < -1e-3 * np.hypot(*(b - a).T)).any():
            return False
    return True


def test_the_footprint_contains_body_and_wheels_and_little_else():
    corners = footprint(fleet_description(BURGER).text)
    wheels = [(x, side * 0.14) for x in (-0.045, 0.045) for side in (-1, 1)]
    body = [(x, side * 0.11) for x in (-0.15, 0.09) for side in (-1, 1)]
    assert contains(corners, wheels + body)
    assert np.abs(corners).max(axis=0) == pytest.approx([0.15, 0.14], abs=0.002)


@pytest.mark.parametrize("seed", range(20))
def test_a_footprint_is_about_base_link_and_contains_each_shape_however_it_is_turned(seed):
    rng = np.random.default_rng(seed)
    shapes = (
        ('<box size="0.3 0.2 0.5"/>', lambda: rng.uniform(-0.5, 0.5, 3) * (0.3, 0.2, 0.5)),
        ('<sphere radius="0.2"/>', lambda: 0.2 * unit(rng)),
        ('<cylinder radius="0.1" length="0.6"/>', lambda: on_drum(rng, 0.1, 0.6)),
    )
    urdf = '<robot name="r"><link name="root"/><link name="base_link"/>'
    urdf += '<joint name="j" type="fixed"><origin xyz="1 2 0" rpy="0 0 1"/>'
    urdf += '<parent link="root"/><child link="base_link"/></joint>'
    points = []
    urdf += '<link name="body"><inertial><mass value="1"/>'
    urdf += '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    for shape, draw in shapes:
        place, turn = rng.uniform(-0.5, 0.5, 3), rng.uniform(-3, 3, 3)
        origin = f'<origin xyz="{" ".join(map(str, place))}" rpy="{" ".join(map(str, turn))}"/>'
        urdf += f"<collision>{origin}<geometry>{shape}</geometry></collision>"
        matrix = rotation(*turn)
        points += [(place + matrix @ draw())[:2] for _ in range(100)]
    urdf += '</link><joint name="k" type="fixed"><parent link="base_link"/><child link="body"/>'
    urdf += "</joint></robot>"
    assert contains(footprint(urdf), points)


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def on_drum(rng, radius, length):
    angle = rng.uniform(-math.pi, math.pi)
    return np.array(
        [radius * math.cos(angle), radius * math.sin(angle), rng.uniform(-length, length) / 2]
    )


def rotation(roll, pitch, yaw):
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


@pytest.mark.parametrize(
    "text", [BURGER, "<robot", '<robot name="r"><link name="base_link"/></robot>']
)
def test_navigation_starts_with_a_pioneers_footprint_if_the_description_has_none(tmp_path, text):
    description = tmp_path / "robot.urdf"
    description.write_text(text)
    said = []
    session = SimpleNamespace(say=said.append)
    robot = RobotEntry("r", description=str(description))
    path = run_navigation._write_footprint(session, robot, tmp_path)
    assert bool(path) == (text == BURGER)
    assert said[0].startswith("the footprint of r is" if path else "warning: r gets the footprint")
    if path:
        costmap = yaml.safe_load(Path(path).read_text())["local_costmap"]
        assert costmap["footprint"] == footprint(fleet_description(BURGER).text)


def test_a_footprint_without_one_of_the_shapes_is_none():
    """A mesh that is not found was left out, and a wide robot drove with the footprint of the rest."""
    shape = "<collision><geometry>{}</geometry></collision>"
    body = shape.format('<box size="0.1 0.1 0.1"/>') + shape.format('<mesh filename="/no.stl"/>')
    with pytest.raises(DescriptionError, match="1 of the 2 collision shapes"):
        footprint(f'<robot name="r"><link name="base_link">{body}</link></robot>')


def test_the_reason_of_xacro_is_said(tmp_path):
    path = tmp_path / "x.xacro"
    path.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="${nope}"/></robot>'
    )
    with pytest.raises(DescriptionError, match="nope"):
        expanded(path)


@pytest.mark.parametrize("data", [b"<a>\xe9</a>", b"\xff"])
def test_a_model_that_is_no_utf_8_is_named(tmp_path, data):
    path = tmp_path / "model.sdf"
    path.write_bytes(data)
    with pytest.raises(SpawnError, match=r"model\.sdf is not UTF-8"):
        spawn_model._text_of(path)


def test_a_robot_without_shapes_or_of_one_line_has_no_footprint():
    line = '<collision><geometry><box size="1 0 0"/></geometry></collision>'
    with pytest.raises(DescriptionError):
        footprint(f'<robot name="r"><link name="base_link">{line}</link></robot>')
    with pytest.raises(DescriptionError, match="no collision shape"):
        footprint('<robot name="r"><link name="base_link"/></robot>')


def test_the_command_prints_the_description_and_says_what_it_changed(tmp_path):
    program = (
        "import sys; from pioneer_gazebo.commands.fleet_description import main; sys.exit(main())"
    )

    def call(path, *options):
        words = [sys.executable, "-c", program, *options, str(path)]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    path = tmp_path / "burger.urdf"
    path.write_text(BURGER)
    done = call(path)
    assert done.returncode == 0, done.stderr
    assert robot_from_urdf(done.stdout) == robot_from_urdf(fleet_description(BURGER).text)
    assert "burger.urdf: commandTopic 'cmd_vel' is 'pioneer/cmd_vel' in the fleet" in done.stderr
    assert json.loads(call(path, "--footprint").stdout) == footprint(fleet_description(BURGER).text)
    path.write_text("<robot")
    done = call(path)
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
