"""Links without gravity do not fall, kinematic ones are moved by nothing; from SDF and from URDF."""

import pytest

from pioneer_gazebo.physics.engine import Physics, Velocity
from pioneer_gazebo.simulation.actor import Wrench
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.sdf import world_from_sdf_text
from pioneer_gazebo.world.urdf import robot_from_urdf

SHAPE = "<collision name='c'><geometry><box><size>0.4 0.4 0.4</size></box></geometry></collision>"
MODEL = """<sdf version='1.6'><model name='m'><pose>0 0 2 0 0 0</pose><link name='a'>{}{}</link></model></sdf>"""
ROBOT = """<robot name='r'><link name='a'><inertial><origin xyz='0.1 0 0'/><mass value='3'/>
<inertia ixx='0.1' iyy='0.1' izz='0.1'/></inertial><collision><geometry><box size='0.4 0.4 0.4'/></geometry></collision>
</link><link name='b'><inertial><mass value='2'/><inertia ixx='0.1' iyy='0.1' izz='0.1'/></inertial></link>
<joint name='j' type='fixed'><origin xyz='0.3 0 0'/><parent link='a'/><child link='b'/></joint>
<gazebo reference='a'>{}</gazebo><gazebo reference='b'>{}</gazebo></robot>"""


def model(extra: str):
    [found] = world_from_sdf_text(MODEL.format(extra, SHAPE)).models
    return found


def advance(simulation, seconds):
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def test_a_model_without_gravity_floats_and_keeps_its_velocity(simulate):
    simulation = simulate()
    simulation.add_model(model("<gravity>false</gravity>"))
    entity = simulation.entity("m")
    advance(simulation, 4.0)
    assert simulation.pose(entity).position == pytest.approx((0, 0, 2), abs=1e-3)
    simulation.place("m", Pose((0.0, 0.0, 2.0)), Velocity((0.2, 0.0, 0.1)))
    advance(simulation, 2.0)
    assert simulation.pose(entity).position == pytest.approx((0.4, 0, 2.2), abs=0.01)
    simulation.configure(Physics(gravity=(0.0, 0.0, -3.7)))
    advance(simulation, 1.0)
    assert simulation.velocity(entity).linear == pytest.approx((0.2, 0, 0.1), abs=0.01)


@pytest.mark.parametrize(
    "text",
    [
        "<turnGravityOff>true</turnGravityOff>",
        "<turnGravityOff value='1'/>",
        "<gravity>0</gravity>",
    ],
)
def test_a_robot_without_gravity_floats_level(simulate, text):
    simulation = simulate()
    entity = simulation.add_robot(
        "r", "", robot_from_urdf(ROBOT.format(text, text)), Pose((0, 0, 2.0))
    )
    advance(simulation, 3.0)
    pose = simulation.pose(entity)
    assert pose.position == pytest.approx((0, 0, 2), abs=1e-3)
    assert pose.rpy() == pytest.approx((0, 0, 0), abs=1e-3)


def test_of_two_links_one_without_gravity_the_other_ones_weight_acts_at_its_own_place(simulate):
    """Three of five kilograms float: the model falls with 2/5 g and turns towards the heavy end."""
    simulation = simulate()
    text = ROBOT.format("<turnGravityOff>true</turnGravityOff>", "")
    entity = simulation.add_robot("r", "", robot_from_urdf(text), Pose((0.0, 0.0, 20.0)))
    advance(simulation, 0.1)
    velocity = simulation.velocity(entity)
    heavy = simulation.velocity(entity).at((0.18, 0.0, 0.0))  # centre of mass
    assert heavy.linear[2] == pytest.approx(-9.81 * 0.4 * 0.1, rel=0.03)
    assert velocity.angular[1] > 0.1


def test_a_kinematic_model_stays_where_services_put_it(simulate):
    simulation = simulate()
    simulation.add_model(model("<kinematic>true</kinematic>"))
    entity = simulation.entity("m")
    push = Wrench(entity, 0, (500.0, 0.0, 0.0), (0.0, 0.0, 50.0), None, 0.0, 1e9)
    simulation.push(push)
    advance(simulation, 2.0)
    assert simulation.pose(entity).position == pytest.approx((0, 0, 2))
    simulation.place("m", Pose((3.0, 0.0, 1.0)))
    advance(simulation, 2.0)
    assert simulation.pose(entity).position == pytest.approx((3, 0, 1))


def test_a_robot_cannot_push_a_kinematic_box_and_sees_it(simulate, robot):
    simulation = simulate()
    simulation.add_model(model("<kinematic>true</kinematic>").moved(Pose((1.0, 0.0, -1.8))))
    entity = simulation.add_robot("p", "", robot, Pose())
    entity.drives[0].command(simulation.moment, 0.5, 0.0)
    advance(simulation, 4.0)
    assert simulation.pose(entity).position[0] < 0.8
    assert simulation.pose(simulation.entity("m")).position == pytest.approx((1, 0, 0.2))
    ranges = simulation.ranges(entity, entity.lasers[0])
    assert min(ranges) < 0.6
