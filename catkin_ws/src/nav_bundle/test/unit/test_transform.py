"""The transform tree interpolates, rejects lookups outside its data, and names missing frames."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nav_bundle.base.pose import Pose
from nav_bundle.base.transform import (
    DisconnectedError,
    ExtrapolationError,
    Transform,
    TransformTree,
)

numbers = st.floats(-10, 10)


def normalised(values: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    length = math.sqrt(sum(value * value for value in values))
    x, y, z, w = (value / length for value in values)
    return x, y, z, w


rotations = st.tuples(numbers, numbers, numbers, st.floats(0.1, 1)).map(normalised)
transforms = st.builds(Transform, st.tuples(numbers, numbers, numbers), rotations)


def turned(x: float, y: float, yaw: float) -> Transform:
    return Transform((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))


def assert_pose(actual: Pose, expected: Pose) -> None:
    assert np.allclose(
        [actual.x, actual.y, actual.yaw], [expected.x, expected.y, expected.yaw], atol=1e-9
    )


def robot_tree() -> TransformTree:
    tree = TransformTree()
    tree.insert("map", "odom", 10.0, turned(1, 2, math.pi / 2))
    for stamp in range(5, 15):
        tree.insert("odom", "base_link", float(stamp), turned(float(stamp), 0, 0))
    tree.insert("base_link", "laser", 0.0, turned(0.1, 0, 0), static=True)
    return tree


@given(transforms, transforms)
def test_composition_agrees_with_matrices(a: Transform, b: Transform) -> None:
    points = np.eye(3)
    assert np.allclose(a.compose(b).apply(points), a.apply(b.apply(points)), atol=1e-8)
    assert np.allclose(a.inverse().apply(a.apply(points)), points, atol=1e-8)


@given(numbers, numbers, st.floats(-3.1, 3.1))
def test_a_planar_transform_is_its_pose(x: float, y: float, yaw: float) -> None:
    assert_pose(turned(x, y, yaw).planar(), Pose(x, y, yaw))


def test_a_lookup_interpolates_between_stamps() -> None:
    assert_pose(robot_tree().lookup("odom", "base_link", 7.25).planar(), Pose(7.25, 0, 0))


def test_a_rotation_is_interpolated_the_short_way_round() -> None:
    tree = TransformTree()
    tree.insert("a", "b", 0.0, turned(0, 0, math.radians(170)))
    tree.insert("a", "b", 1.0, turned(0, 0, math.radians(-170)))
    assert abs(math.degrees(tree.lookup("a", "b", 0.25).planar().yaw) - 175) < 1e-6


def test_a_lookup_climbs_over_static_and_moving_edges_and_back() -> None:
    tree = robot_tree()
    forth = tree.lookup("map", "laser", 10.0)
    assert_pose(forth.planar(), Pose(1, 12.1, math.pi / 2))
    assert_pose(tree.lookup("laser", "map", 10.0).compose(forth).planar(), Pose())


def test_the_newest_common_time_is_that_of_the_slowest_edge() -> None:
    assert robot_tree().latest("map", "laser") == 10.0
    assert_pose(robot_tree().lookup("map", "base_link").planar(), Pose(1, 12, math.pi / 2))
    assert robot_tree().latest("base_link", "laser") == math.inf


def test_a_frame_seen_from_itself_is_the_identity() -> None:
    assert_pose(TransformTree().lookup("map", "map").planar(), Pose())


def test_a_missing_frame_is_named() -> None:
    with pytest.raises(DisconnectedError, match="no transform of 'camera' has arrived"):
        robot_tree().lookup("map", "camera")


def test_two_trees_are_named_by_their_roots() -> None:
    tree = robot_tree()
    tree.insert("world", "car", 1.0, Transform())
    with pytest.raises(DisconnectedError, match="'odom' ends at 'map' and 'car' ends at 'world'"):
        tree.lookup("odom", "car")


@pytest.mark.parametrize(("stamp", "future"), [(4.0, False), (15.0, True)])
def test_no_transform_is_invented_outside_what_arrived(stamp: float, future: bool) -> None:
    with pytest.raises(ExtrapolationError, match="'odom' to 'base_link'") as caught:
        robot_tree().lookup("odom", "base_link", stamp)
    assert caught.value.future is future


def test_transforms_may_arrive_out_of_order() -> None:
    tree = TransformTree()
    for stamp in (3.0, 1.0, 2.0, 2.0):
        tree.insert("a", "b", stamp, turned(stamp * stamp, 0, 0))
    assert_pose(tree.lookup("a", "b", 2.0).planar(), Pose(4, 0, 0))
    assert_pose(tree.lookup("a", "b", 1.5).planar(), Pose(2.5, 0, 0))


def test_old_transforms_are_forgotten() -> None:
    tree = TransformTree(keep=1.0)
    for step in range(1000):
        tree.insert("a", "b", step * 0.01, Transform())
    assert 1.0 <= 9.99 - tree._edges["b"].oldest <= 2.01


def test_a_frame_moves_to_a_new_parent() -> None:
    tree = robot_tree()
    assert tree.insert("platform", "base_link", 20.0, Transform())
    assert tree.chain("laser") == ["laser", "base_link", "platform"]


def test_clearing_keeps_static_transforms() -> None:
    tree = robot_tree()
    tree.clear()
    assert_pose(tree.lookup("base_link", "laser", 3.0).planar(), Pose(0.1, 0, 0))
    with pytest.raises(DisconnectedError):
        tree.lookup("odom", "base_link")


def test_a_loop_of_frames_ends() -> None:
    tree = TransformTree()
    tree.insert("a", "b", 0.0, Transform())
    tree.insert("b", "a", 0.0, Transform())
    assert tree.chain("a") == ["a", "b"]
