import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.world.model import Box, Cylinder
from pioneer_gazebo.world.urdf import robot_from_urdf

CART = """
<robot name="cart">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"/>
  <link name="body">
    <inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry><material name="red"/></visual>
    <collision><origin xyz="0 0 0.5"/><geometry><box size="1 2 3"/></geometry></collision>
  </link>
  <link name="left"><collision><geometry><cylinder radius="0.1" length="0.05"/></geometry></collision></link>
  <link name="right"/>
  <joint name="fix" type="fixed">
    <origin xyz="0 0 1" rpy="0 0 1.5707963"/><parent link="base"/><child link="body"/>
  </joint>
  <joint name="l" type="continuous">
    <origin xyz="1 0 0"/><parent link="body"/><child link="left"/><axis xyz="0 2 0"/>
  </joint>
  <joint name="r" type="revolute">
    <parent link="body"/><child link="right"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="3" velocity="4"/><dynamics damping="0.5" friction="0.25"/>
  </joint>
  {extra}
</robot>
"""
DRIVE = """<gazebo><plugin name="d" filename="libgazebo_ros_diff_drive.so">
  <leftJoint>l</leftJoint><rightJoint>r</rightJoint>{extra}</plugin></gazebo>"""
LASER = """<gazebo reference="body"><sensor type="ray" name="s"><update_rate>40</update_rate>{pose}<ray>
  <scan><horizontal><samples>{samples}</samples><min_angle>-1</min_angle><max_angle>1</max_angle></horizontal></scan>
  <range><min>0.1</min><max>30</max><resolution>0.01</resolution></range>
  <noise><type>gaussian</type><mean>0.0</mean><stddev>0.01</stddev></noise></ray>
  <plugin name="p" filename="libgazebo_ros_laser.so"><topicName>scan</topicName><frameName>laser</frameName></plugin>
  </sensor></gazebo>"""


def cart(extra=""):
    return robot_from_urdf(CART.format(extra=extra), "cart.urdf")


def test_links_know_where_they_are_in_the_root():
    robot = cart()
    assert robot.root.name == "base"
    assert robot.link("left").pose.position == pytest.approx((0, 1, 1), abs=1e-6)
    assert robot.link("left").pose.yaw == pytest.approx(math.pi / 2, abs=1e-6)


def test_shapes_masses_and_colours_are_read():
    robot = cart()
    body = robot.link("body")
    assert body.collisions[0].shape == Box((1, 2, 3))
    assert robot.link("left").collisions[0].shape == Cylinder(0.1, 0.05)
    assert body.visuals[0].colour == (1, 0, 0, 1)
    assert (body.mass, robot.link("base").mass) == (2, 0)


def test_joint_limits_and_axis_are_read():
    joint, left = (next(one for one in cart().joints if one.name == name) for name in ("r", "l"))
    assert (joint.lower, joint.upper, joint.effort, joint.velocity) == (-1, 2, 3, 4)
    assert (joint.damping, joint.friction) == (0.5, 0.25)
    assert left.axis == (0, 1, 0)
    assert left.upper == math.inf


def test_friction_and_colour_of_a_gazebo_reference_apply_to_the_link():
    robot = cart('<gazebo reference="body"><mu1>0.2</mu1><material>Gazebo/Blue</material></gazebo>')
    assert robot.link("body").collisions[0].friction == 0.2
    assert robot.link("body").visuals[0].colour == (0, 0, 1, 1)


def test_drive_is_read_under_the_plugins_names():
    extra = "<wheelSeparation>0.4</wheelSeparation><torque>7</torque>"
    extra += "<odometrySource>0</odometrySource><publishTf>0</publishTf>"
    (drive,) = cart(DRIVE.format(extra=extra)).drives
    assert (drive.wheelSeparation, drive.wheelTorque, drive.odometrySource, drive.publishTf) == (
        0.4,
        7,
        "encoder",
        False,
    )


def test_laser_is_read_under_the_sensors_names():
    (laser,) = cart(LASER.format(samples=720, pose="<pose>0 0 1 0 0 0</pose>")).lasers
    assert (laser.samples, laser.min_angle, laser.max_range, laser.update_rate) == (720, -1, 30, 40)
    assert (laser.noise_stddev, laser.topic, laser.frame, laser.link) == (
        0.01,
        "scan",
        "laser",
        "body",
    )
    assert laser.pose.position == (0, 0, 1)


def test_unknown_plugins_and_elements_are_named_once():
    other = '<gazebo><plugin name="x" filename="libgazebo_ros_wings.so"/></gazebo>'
    robot = cart(other * 2 + DRIVE.format(extra="<wheelSeperation>1</wheelSeperation>"))
    assert robot.warnings == (
        "plugin libgazebo_ros_wings.so is not supported and ignored",
        "<wheelSeperation> of plugin libgazebo_ros_diff_drive.so is not supported and ignored; "
        "did you mean <wheelSeparation>?",
    )


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (DRIVE.format(extra="<wheelDiameter>0</wheelDiameter>"), "wheelDiameter must be above 0"),
        (DRIVE.format(extra="<wheelDiameter>big</wheelDiameter>"), "'big' is not a number"),
        (DRIVE.format(extra="<odometrySource>gps</odometrySource>"), "encoder or world"),
        (DRIVE.format(extra="").replace(">l<", ">left<"), "unknown joint 'left'"),
        (LASER.format(samples=0, pose=""), "samples.* must be 1 or more"),
        (LASER.format(samples=1.5, pose=""), "whole number"),
        (
            LASER.format(samples=5, pose="").replace("body", "bod"),
            r"unknown link 'bod'; did you mean 'body'\?",
        ),
        (
            '<gazebo><plugin name="p" filename="libgazebo_ros_p3d.so"/></gazebo>',
            "<bodyName> is missing",
        ),
        (
            '<gazebo><plugin name="p" filename="libgazebo_ros_p3d.so"><bodyName>tail</bodyName></plugin></gazebo>',
            "unknown link 'tail'",
        ),
        ('<gazebo reference="tail"><mu1>1</mu1></gazebo>', "unknown link 'tail'"),
        ('<gazebo reference="body"><mu1>much</mu1></gazebo>', "'much' is not a number"),
        ("<gazebo><static>maybe</static></gazebo>", "maybe"),
    ],
)
def test_what_makes_no_sense_beside_links_and_joints_is_left_out_with_file_and_element(
    extra, message
):
    """As in Gazebo, the robot has everything else."""
    other = '<gazebo><plugin name="p" filename="libgazebo_ros_planar_move.so"/></gazebo>'
    robot = cart(extra + other)
    [warning] = robot.warnings
    assert warning.startswith("cart.urdf, line ")
    assert re.search(f"{message}.*; it is left out$", warning)
    assert [device.name for device in robot.devices] == ["p"]


def test_joints_that_a_robot_does_not_have_are_left_out_of_its_joint_states():
    states = """<gazebo><plugin name="p" filename="libgazebo_ros_joint_state_publisher.so">
      <jointName>{}</jointName></plugin></gazebo>"""
    robot = cart(states.format("l, elbow, r"))
    [device] = robot.devices
    assert device.jointName == ("l", "r")
    [warning] = robot.warnings
    assert "unknown joint 'elbow'" in warning
    assert cart(states.format("elbow shoulder")).devices == ()


def test_the_axis_of_a_joint_that_does_not_turn_may_be_anything():
    robot = cart("""<link name="a"/><link name="b"/>
      <joint name="ja" type="fixed"><parent link="base"/><child link="a"/><axis xyz="0 0 0"/></joint>
      <joint name="jb" type="continuous"><parent link="base"/><child link="b"/><axis xyz="0 0 0"/></joint>""")
    [warning] = robot.warnings
    assert "must not be 0 0 0; the x axis is taken" in warning
    assert 'name="jb"' in warning


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ('<link name="loose"/>', "must have exactly one root link, found 2: base, loose"),
        (
            '<joint name="j" type="bent"><parent link="base"/><child link="left"/></joint>',
            "'bent' is not one of",
        ),
        (
            '<joint name="j" type="fixed"><parent link="base"/><child link="left"/></joint>',
            "child of two joints",
        ),
        (
            '<joint name="j" type="fixed"><parent link="base"/><child link="x"/></joint>',
            "no link 'x'",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_with_file_and_element(extra, message):
    with pytest.raises(DescriptionError, match=message) as caught:
        cart(extra)
    assert str(caught.value).startswith("cart.urdf, line ")


def test_details_that_no_body_has_are_noted_with_their_line_and_left_out():
    robot = cart("""<link name="bad"><inertial><mass value="0"/></inertial>
      <collision><geometry><box size="0 1 1"/></geometry></collision></link>
      <link name="light"><inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
      <joint name="j1" type="fixed"><parent link="base"/><child link="bad"/></joint>
      <joint name="j2" type="fixed"><parent link="base"/><child link="light"/></joint>""")
    assert robot.link("bad").mass == 0
    assert robot.link("bad").collisions == ()
    assert robot.link("light").inertia.ixx == pytest.approx(0.02)
    assert [line.partition(": ")[0].startswith("cart.urdf, line ") for line in robot.warnings] == [
        True
    ] * 3
    assert "value must be > 0 (got 0)" in robot.warnings[0]


VALUES = {"mu1": st.floats(0, 10), "mu": st.floats(0, 10), "mu2": st.floats(0, 10), "kp": st.floats(0, 1e9),
          "selfCollide": st.booleans(), "material": st.sampled_from(["Gazebo/Blue", "Gazebo/Red"])}  # fmt: skip


@given(st.fixed_dictionaries({}, optional=VALUES))
def test_both_spellings_of_a_surface_give_the_same_robot(values):
    words = {
        tag: str(value).lower() if isinstance(value, bool) else str(value)
        for tag, value in values.items()
    }
    inside = "".join(f"<{tag}>{word}</{tag}>" for tag, word in words.items())
    attribute = "".join(f'<{tag} value="{word}"/>' for tag, word in words.items())
    one, other = (cart(f'<gazebo reference="body">{text}</gazebo>') for text in (inside, attribute))
    assert one == other
    named = {tag for tag in values if f"<{tag}>" in " ".join(one.warnings)}
    assert named <= {"mu2", "fdir1", "selfCollide", "laserRetro"}


def test_joints_in_a_circle_are_refused():
    text = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="x" type="fixed"><parent link="b"/><child link="c"/></joint>
      <joint name="y" type="fixed"><parent link="c"/><child link="b"/></joint></robot>"""
    with pytest.raises(DescriptionError, match="loop: x, y"):
        robot_from_urdf(text)


def test_xacro_that_is_not_expanded_is_refused():
    text = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>'
    with pytest.raises(DescriptionError, match="expand it first"):
        robot_from_urdf(text)
