"""An effort on a joint accelerates what the joint moves, for as long as it was asked for."""

import math

import pytest

from pioneer_gazebo.physics.bound import BoundError
from pioneer_gazebo.simulation.actor import Effort
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.urdf import robot_from_urdf

MASS, MOMENT = 2.0, 0.5
MODEL = """<robot name="r"><link name="base"><inertial><mass value="5000"/>
<inertia ixx="5000" iyy="5000" izz="5000" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="2 2 0.4"/></geometry></collision></link>
<link name="moved"><inertial><mass value="2"/>
<inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="{kind}"><origin xyz="0 0 1" rpy="{rpy}"/><parent link="base"/><child link="moved"/>
<axis xyz="{axis}"/><limit lower="-100" upper="100" effort="1000" velocity="1000"/></joint></robot>"""


@pytest.fixture
def jointed(simulate):
    """Returns a function that makes a heavy base with a part on a joint."""

    def make(kind, axis, rpy="0 0 0"):
        simulation = simulate()
        model = robot_from_urdf(MODEL.format(kind=kind, axis=axis, rpy=rpy))
        return simulation, simulation.add_robot("r", "r", model, Pose((0.0, 0.0, 0.2)))

    return make


def rate(simulation, entity):
    [state] = simulation.joints(entity, [1])
    return state.rate


def advance(simulation, seconds):
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


@pytest.mark.parametrize("effort", [1.0, -3.0])
@pytest.mark.parametrize(
    ("kind", "axis", "rpy", "inertia"),
    [
        ("continuous", "0 0 1", "0 0 0", MOMENT),
        ("revolute", "0 0 1", "0 0 1.2", MOMENT),
        ("continuous", "1 0 0", "0 -1.5707963 0", MOMENT),
        ("prismatic", "1 0 0", "0 0 0.7", MASS),
        ("prismatic", "0 1 0", "0 0 0", MASS),
    ],
)
def test_an_effort_for_half_a_second_gives_the_joint_its_impulse(
    jointed, effort, kind, axis, rpy, inertia
):
    simulation, entity = jointed(kind, axis, rpy)
    advance(simulation, 0.1)
    now = simulation.tick
    simulation.push(Effort(entity, 1, effort, now, now + 0.5 * TICK_RATE))
    advance(simulation, 1.0)
    assert rate(simulation, entity) == pytest.approx(0.5 * effort / inertia, rel=0.03)


def test_an_endless_effort_ends_when_it_is_cleared_and_a_wrench_stays(jointed):
    simulation, entity = jointed("continuous", "0 0 1")
    simulation.push(Effort(entity, 1, 1.0, 0.0, math.inf))
    advance(simulation, 0.5)
    simulation.clear_pushes(Effort, entity, 1)
    first = rate(simulation, entity)
    advance(simulation, 0.5)
    assert first == pytest.approx(1.0, rel=0.05)
    assert rate(simulation, entity) == pytest.approx(first, rel=0.03)


@pytest.mark.parametrize("effort", [math.nan, math.inf, 1e12])
def test_an_effort_out_of_bounds_is_refused(jointed, effort):
    simulation, entity = jointed("continuous", "0 0 1")
    with pytest.raises(BoundError, match="effort"):
        simulation.push(Effort(entity, 1, effort, 0.0, 1.0))
