"""Actors: their scripts, their SDF, and how lasers see them and robots collide with them."""

import math

import numpy as np
import pytest

from pioneer_gazebo.error import DescriptionError, ModelError
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.world.model import Box, Cylinder, Model, Script, Trajectory, Waypoint
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.sdf import world_from_sdf_text


def waypoint(time, pose):
    return f"<waypoint><time>{time}</time><pose>{pose}</pose></waypoint>"


def actor(*trajectories, inner="", script="", name="walker"):
    ways = "".join(
        f"<trajectory id='{i}' type='walking'>{''.join(way)}</trajectory>"
        for i, way in enumerate(trajectories)
    )
    text = f"<actor name='{name}'>{inner}<script>{script}{ways}</script></actor>"
    world = world_from_sdf_text(f"<sdf version='1.6'><world name='w'>{text}</world></sdf>")
    assert world.warnings == ()
    (model,) = world.models
    return model


STRAIGHT = (waypoint(0, "0 0 0 0 0 0"), waypoint(4, "4 0 0 0 0 0"))


def at(model: Model, time):
    return model.script.pose(time).position


def seconds(value):
    return round(value * TICK_RATE)


def test_a_straight_way_begins_and_ends_gently_as_in_gazebo():
    model = actor(STRAIGHT)
    for time, x in ((0.0, 0.0), (1.0, 0.8125), (2.0, 2.0), (3.0, 3.1875)):
        assert at(model, time) == pytest.approx((x, 0, 0))


def test_a_way_passes_its_waypoints_at_their_times_and_turns_the_short_way():
    model = actor(
        (waypoint(0, "0 0 0 0 0 3"), waypoint(1, "1 2 0 0 0 -3"), waypoint(3, "5 -1 0 0 0 0"))
    )
    assert at(model, 1.0) == pytest.approx((1, 2, 0))
    assert abs(model.script.pose(0.5).yaw) == pytest.approx(math.pi)


@pytest.mark.parametrize("tension", [0.0, 1.0])
def test_tension_keeps_a_way_from_swinging_past_a_corner(tension):
    corner = [Waypoint(t, Pose((x, y, 0.0))) for t, x, y in ((0, 0, 0), (1, 1, 0), (2, 1, 1))]
    way = Trajectory(tuple(corner), tension)
    farthest = max(way.pose(t).position[0] for t in np.linspace(0, 2, 101))
    assert (farthest > 1.01) == (tension == 0.0)


def test_trajectories_follow_each_other_and_the_script_loops():
    back = (waypoint(0, "4 0 0 0 0 3.14159"), waypoint(2, "0 0 0 0 0 3.14159"))
    model = actor(STRAIGHT, back)
    assert at(model, 5.0) == pytest.approx((2, 0, 0))
    assert at(model, 8.0) == pytest.approx((2, 0, 0))
    once = actor(STRAIGHT, back, script="<loop>false</loop>")
    assert at(once, 7.0) == pytest.approx((0, 0, 0))


def test_the_delay_comes_before_every_round_and_without_auto_start_nothing_moves():
    model = actor(STRAIGHT, script="<delay_start>2</delay_start>", inner="<pose>9 9 0 0 0 0</pose>")
    assert at(model, 1.0) == (9, 9, 0)
    assert at(model, 4.0) == pytest.approx((2, 0, 0))
    assert at(model, 7.0) == pytest.approx((4, 0, 0))
    assert at(model, 10.0) == pytest.approx((2, 0, 0))
    still = actor(STRAIGHT, script="<auto_start>false</auto_start>")
    assert at(still, 99.0) == (0, 0, 0)


def test_an_actor_without_collisions_is_an_upright_person_on_the_ground():
    tilted = (waypoint(0, "0 0 1.21 1.57 0 0.5"), waypoint(4, "4 0 1.21 1.57 0 0.5"))
    model = actor(
        tilted, inner="<skin><filename>walk.dae</filename></skin><animation name='walking'/>"
    )
    (link,) = model.links
    (collision,) = link.collisions
    foot = model.script.pose(2.0).compose(collision.pose)
    assert isinstance(collision.shape, Cylinder)
    assert foot.position == pytest.approx((2, 0, 0.9))
    assert foot.rpy() == pytest.approx((0, 0, 0.5))


def test_tension_is_an_attribute_of_the_trajectory():
    way = "<trajectory id='0' type='' tension='{}'>{}</trajectory>"
    text = f"<sdf version='1.7'><actor name='a'><script>{way}</script></actor></sdf>"
    (model,) = world_from_sdf_text(text.format(0.5, waypoint(0, "0 0 0 0 0 0"))).models
    assert model.script.trajectories[0].tension == 0.5
    with pytest.raises(DescriptionError, match="tension must be 0 to 1, not 2"):
        world_from_sdf_text(text.format(2, waypoint(0, "0 0 0 0 0 0")))


def test_an_actor_keeps_the_collisions_it_has():
    box = "<collision name='c'><geometry><box><size>1 2 3</size></box></geometry></collision>"
    model = actor(STRAIGHT, inner=f"<link name='l'>{box}</link>")
    assert model.links[0].collisions[0].shape == Box((1, 2, 3))


@pytest.mark.parametrize(
    ("trajectory", "word"),
    [
        ((), "no <waypoint>"),
        ((waypoint(1, "0 0 0 0 0 0"), waypoint(1, "1 0 0 0 0 0")), "two waypoints have the time 1"),
        ((waypoint(-1, "0 0 0 0 0 0"),), "must not be below 0"),
        ((waypoint("nan", "0 0 0 0 0 0"),), "not a finite number"),
        ((waypoint(0, "0 0 0"),), "needs 6 numbers"),
    ],
)
def test_a_script_that_makes_no_sense_is_refused_by_name(trajectory, word):
    with pytest.raises(DescriptionError, match=f'name="walker".*{word}'):
        actor(trajectory)


def test_a_laser_and_a_sonar_see_an_actor_where_it_is(simulate, robot):
    walker = actor((waypoint(0, "3 0 0 0 0 0"), waypoint(10, "13 0 0 0 0 0")))
    simulation = simulate(walker)
    entity = simulation.add_robot("r", "", robot, Pose())
    [mounted] = entity.lasers
    ahead = mounted.laser.config.samples // 2
    for time in (1.0, 3.456):
        simulation.advance(seconds(time))
        eye = simulation.link_pose(entity, "laser").position[0]
        nearest = simulation.ranges(entity, mounted)[ahead - 3 : ahead + 3].min()
        assert nearest == pytest.approx(at(walker, time)[0] - 0.25 - eye, abs=0.06)


def test_an_actor_pushes_a_sleeping_robot_along_and_is_not_slowed_down(simulate, robot):
    walker = actor((waypoint(0, "-4 0 0 0 0 0"), waypoint(8, "4 0 0 0 0 0")))
    simulation = simulate(walker)
    entity = simulation.add_robot("r", "", robot, Pose())
    simulation.advance(seconds(3.0))
    assert entity.collisions.count == 0
    simulation.advance(seconds(7.0))
    assert simulation.pose(simulation.entity("walker")).position == at(walker, 7.0)
    x, y, z = simulation.pose(entity).position
    assert entity.collisions.count >= 1
    assert math.hypot(x - at(walker, 7.0)[0], y) > 0.35
    assert abs(z) < 0.05


def test_actors_walk_through_walls_and_on_any_ground(simulate, box):
    wall = box("wall", Pose((2.0, 0.0, 0.5)), (0.2, 4.0, 1.0))
    simulation = simulate(wall, actor(STRAIGHT))
    simulation.advance(seconds(2.0))
    entity = simulation.entity("walker")
    assert simulation.pose(entity).position == pytest.approx((2, 0, 0))
    assert simulation.velocity(entity).linear == pytest.approx((1.25, 0, 0), abs=0.01)


def test_a_reset_starts_the_script_over(simulate):
    simulation = simulate(actor(STRAIGHT))
    entity = simulation.entity("walker")
    simulation.advance(seconds(3.0))
    simulation.reset_poses()
    assert simulation.pose(entity).position == pytest.approx((0, 0, 0))
    simulation.advance(seconds(5.0))
    assert simulation.pose(entity).position == pytest.approx((2, 0, 0))
    simulation.reset()
    simulation.advance(seconds(2.0))
    assert simulation.pose(entity).position == pytest.approx((2, 0, 0))


def test_an_actor_cannot_be_placed_but_removed(simulate):
    simulation = simulate(actor(STRAIGHT))
    with pytest.raises(ModelError, match="follows its script"):
        simulation.place("walker", Pose())
    simulation.remove("walker")
    simulation.advance(seconds(1.0))
    assert "walker" not in simulation.names()


def test_a_leap_from_end_to_beginning_pushes_nobody_away(simulate, box):
    crate = box("crate", Pose((2.0, 0.0, 0.1)), (0.2, 0.2, 0.2), static=False)
    once = Script(
        (Trajectory((Waypoint(0, Pose((0, 5, 0))), Waypoint(1, Pose((4, 5, 0))))),), Pose()
    )
    walker = actor(STRAIGHT)
    simulation = simulate(crate, Model("leaper", links=walker.links, script=once))
    simulation.advance(seconds(10.0))
    assert simulation.pose(simulation.entity("crate")).position[:2] == pytest.approx(
        (2, 0), abs=0.01
    )


def test_a_spawned_actor_walks_from_where_it_is_put():
    moved = actor(STRAIGHT).moved(Pose.from_rpy(1.0, 1.0, 0.0, yaw=math.pi / 2))
    assert at(moved, 2.0) == pytest.approx((1, 3, 0))
