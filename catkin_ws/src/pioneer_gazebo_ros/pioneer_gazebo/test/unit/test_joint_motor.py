"""Controllers of ros_control move joints to positions, at speeds and by efforts; other joints follow them."""

import math
import random

import pytest

from pioneer_gazebo.simulation.drive import CommandError
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import JointControl, MimicJoint
from pioneer_gazebo.world.ros_control import controlled
from pioneer_gazebo.world.urdf import robot_from_urdf

INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
LINK = '<link name="{0}"><inertial><origin xyz="0.2 0 0"/><mass value="{1}"/>{2}</inertial></link>'
JOINT = """<joint name="{0}" type="{1}"><origin xyz="{2}"/><parent link="base"/><child link="{0}_link"/>
<axis xyz="{3}"/>{4}</joint>"""
CONTROL = """<gazebo><plugin name="c" filename="libgazebo_ros_control.so">
<robotNamespace>{}</robotNamespace></plugin></gazebo>"""


def arm(lift_limit="", pan_limit="", extra="", namespace="/arm"):
    """Returns a heavy base with an arm that pitches, one that pans, and a lift."""
    base = '<link name="base"><inertial><mass value="500"/><inertia ixx="50" iyy="50" izz="50" ixy="0" ixz="0"'
    base += ' iyz="0"/></inertial><collision><geometry><box size="2 2 0.4"/></geometry></collision></link>'
    links = "".join(LINK.format(f"{name}_link", 2, INERTIA) for name in ("pitch", "pan", "lift"))
    joints = JOINT.format("pitch", "revolute", "0 0 1", "0 1 0", PITCH_LIMIT)
    joints += JOINT.format("pan", "continuous", "0.5 0 1", "0 0 1", pan_limit)
    joints += JOINT.format("lift", "prismatic", "-0.5 0 1", "0 0 1", lift_limit or LIFT_LIMIT)
    text = f'<robot name="arm">{base}{links}{joints}{CONTROL.format(namespace)}{extra}</robot>'
    return robot_from_urdf(text)


PITCH_LIMIT = '<limit lower="-1" upper="1" effort="50" velocity="2"/>'
LIFT_LIMIT = '<limit lower="0" upper="0.5" effort="100" velocity="0.25"/>'


def with_controller(robot, **parameters):
    devices, notes = controlled(robot, {"it": parameters})
    assert not notes
    return type(robot)(robot.name, robot.links, robot.joints, devices)


def spawned(simulation, robot):
    return simulation.add_robot("arm", "", robot, Pose((0.0, 0.0, 0.2)))


def advance(simulation, seconds):
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def position(simulation, entity, joint):
    [state] = simulation.joints(entity, [entity.body.joint_index(joint)])
    return state


@pytest.mark.parametrize(
    "kind",
    [
        "position_controllers/JointPositionController",
        "velocity_controllers/JointPositionController",
        "effort_controllers/JointPositionController",
    ],
)
def test_a_position_controller_moves_its_joint_within_the_velocity_limit(simulate, kind):
    simulation = simulate()
    entity = spawned(simulation, with_controller(arm(), type=kind, joint="lift"))
    [motors] = entity.motors
    advance(simulation, 1.0)
    assert position(simulation, entity, "lift").position == pytest.approx(0.0, abs=1e-3)
    motors.command(simulation.moment, [0.4])
    advance(simulation, 1.0)
    assert position(simulation, entity, "lift").position == pytest.approx(0.25, abs=0.01)
    advance(simulation, 1.5)
    assert position(simulation, entity, "lift").position == pytest.approx(0.4, abs=1e-3)
    motors.command(simulation.moment, [3.0])
    advance(simulation, 2.0)
    assert position(simulation, entity, "lift").position == pytest.approx(0.5, abs=1e-3)


def test_a_held_arm_does_not_sag_and_holds_where_it_was_spawned_after_a_reset(simulate):
    simulation = simulate()
    robot = with_controller(
        arm(), type="position_controllers/JointPositionController", joint="pitch"
    )
    entity = spawned(simulation, robot)
    entity.motors[0].command(simulation.moment, [-0.6])
    advance(simulation, 5.0)
    assert position(simulation, entity, "pitch").position == pytest.approx(-0.6, abs=1e-3)
    simulation.reset()
    advance(simulation, 2.0)
    assert position(simulation, entity, "pitch").position == pytest.approx(0.0, abs=1e-3)


def test_a_position_controller_without_a_command_holds_its_joint_where_it_was_put(simulate):
    """It drew the joint to 0, and so undid what ``spawn_model -J`` had set."""
    simulation = simulate()
    robot = with_controller(
        arm(), type="position_controllers/JointPositionController", joint="pitch"
    )
    entity = spawned(simulation, robot)
    advance(simulation, 0.5)
    simulation.set_joint(entity, "pitch", -0.8)
    advance(simulation, 10.0)
    assert position(simulation, entity, "pitch").position == pytest.approx(-0.8, abs=1e-3)


def test_a_velocity_controller_turns_its_joint_until_the_next_command(simulate):
    simulation = simulate()
    robot = with_controller(arm(), type="velocity_controllers/JointVelocityController", joint="pan")
    entity = spawned(simulation, robot)
    entity.motors[0].command(simulation.moment, [1.5])
    advance(simulation, 2.0)
    state = position(simulation, entity, "pan")
    assert (state.position, state.rate) == pytest.approx((3.0, 1.5), abs=0.05)
    entity.motors[0].command(simulation.moment, [0.0])
    advance(simulation, 1.0)
    assert position(simulation, entity, "pan").rate == pytest.approx(0.0, abs=1e-3)


def test_an_effort_controller_accelerates_its_joint(simulate):
    simulation = simulate()
    robot = with_controller(arm(), type="effort_controllers/JointEffortController", joint="pan")
    entity = spawned(simulation, robot)
    advance(simulation, 0.1)
    entity.motors[0].command(simulation.moment, [0.2])
    advance(simulation, 1.0)
    # Inertia about the joint: 0.01 + 2 * 0.2² kg m².
    assert position(simulation, entity, "pan").rate == pytest.approx(0.2 / 0.09, rel=0.05)


def test_a_group_of_joints_takes_a_number_for_each(simulate):
    simulation = simulate()
    kind = "position_controllers/JointGroupPositionController"
    entity = spawned(simulation, with_controller(arm(), type=kind, joints=["lift", "pitch"]))
    [motors] = entity.motors
    with pytest.raises(CommandError, match="needs 2 numbers"):
        motors.command(simulation.moment, [0.1])
    with pytest.raises(CommandError, match="finite"):
        motors.command(simulation.moment, [0.1, math.nan])
    motors.command(simulation.moment, [0.1, 0.5])
    advance(simulation, 2.0)
    for joint, wanted in (("lift", 0.1), ("pitch", 0.5)):
        assert position(simulation, entity, joint).position == pytest.approx(wanted, abs=1e-3)


def test_an_arm_that_stands_falls_asleep_and_a_command_wakes_it(simulate):
    simulation = simulate()
    kind = "position_controllers/JointPositionController"
    entity = spawned(simulation, with_controller(arm(), type=kind, joint="pan"))
    advance(simulation, 4.0)
    assert entity.at_rest
    entity.motors[0].command(simulation.moment, [0.7])
    advance(simulation, 1.0)
    assert position(simulation, entity, "pan").position == pytest.approx(0.7, abs=1e-3)


@pytest.mark.parametrize("by_plugin", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_mimic_joint_follows_its_joint(simulate, by_plugin, seed):
    rng = random.Random(seed)
    multiplier, offset = rng.uniform(-2.0, 2.0), rng.uniform(-0.5, 0.5)
    mimic, extra = "", ""
    if by_plugin:
        extra = f"""<gazebo><plugin name="m" filename="libroboticsgroup_gazebo_mimic_joint_plugin.so">
        <joint>pitch</joint><mimicJoint>pan</mimicJoint><multiplier>{multiplier}</multiplier>
        <offset>{offset}</offset></plugin></gazebo>"""
    else:
        mimic = f'<mimic joint="pitch" multiplier="{multiplier}" offset="{offset}"/>'
    robot = arm(pan_limit=mimic, extra=extra)
    assert robot.warnings == ()
    kind = "position_controllers/JointPositionController"
    entity = spawned(simulation := simulate(), with_controller(robot, type=kind, joint="pitch"))
    for _ in range(4):
        entity.motors[0].command(simulation.moment, [rng.uniform(-1.0, 1.0)])
        advance(simulation, 0.3)
        led = position(simulation, entity, "pitch").position
        assert position(simulation, entity, "pan").position == pytest.approx(
            multiplier * led + offset, abs=0.05
        )
    advance(simulation, 2.0)
    led = position(simulation, entity, "pitch").position
    assert position(simulation, entity, "pan").position == pytest.approx(
        multiplier * led + offset, abs=1e-3
    )


@pytest.mark.parametrize(
    ("mimic", "reason"),
    [
        ('<mimic joint="pich"/>', "unknown joint 'pich'; did you mean 'pitch'"),
        ('<mimic joint="pan"/>', "cannot follow itself"),
        ('<mimic joint="pitch" multiplier="two"/>', "'two' is not a number"),
        ("<mimic/>", 'attribute "joint" is missing'),
    ],
)
def test_a_mimic_that_cannot_be_is_left_out_with_its_line(mimic, reason):
    robot = arm(pan_limit=mimic)
    assert robot.of(MimicJoint) == ()
    [line] = robot.warnings
    assert reason in line
    assert "line" in line


def test_controllers_are_in_the_namespace_of_the_plugin():
    robot = with_controller(
        arm(namespace="/left"), type="velocity_controllers/JointVelocityController", joint="pan"
    )
    [control] = robot.of(JointControl)
    assert control.namespace == "left"


@pytest.mark.parametrize("joint", ["pam", "fixed"])
def test_a_controller_of_an_unknown_or_fixed_joint_is_left_out_and_the_robot_spawned(joint):
    extra = '<link name="f"/><joint name="fixed" type="fixed"><parent link="base"/><child link="f"/></joint>'
    kind = "velocity_controllers/JointVelocityController"
    parameters = {"bad": {"type": kind, "joint": joint}, "good": {"type": kind, "joint": "pan"}}
    devices, notes = controlled(arm(extra=extra), parameters)
    assert [device.name for device in devices] == ["good"]
    [line] = notes
    assert line.startswith(f"bad/joint: unknown joint '{joint}'")
    assert line.endswith("the controller is left out")


def test_a_joint_that_follows_itself_by_a_plugin_is_left_out_by_name():
    """It turned at 100 rad/s for ever."""
    plugin = """<gazebo><plugin name="m" filename="libroboticsgroup_gazebo_mimic_joint_plugin.so">
    <joint>pan</joint><mimicJoint>pan</mimicJoint><multiplier>2</multiplier></plugin></gazebo>"""
    robot = arm(extra=plugin)
    assert not robot.of(MimicJoint)
    assert any("a joint cannot follow itself" in line for line in robot.warnings)


def test_a_joint_of_two_controllers_is_named():
    one = {"type": "position_controllers/JointPositionController", "joint": "pan"}
    devices, notes = controlled(arm(), {"one": one, "two": one})
    assert sum(isinstance(device, JointControl) for device in devices) == 2
    assert notes == ["joint pan has several controllers: the last one moves it"]
