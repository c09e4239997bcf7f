"""Array messages serialise to the same bytes as genpy's; conversions lose only z, roll and pitch."""

import io
import math
import time

import genpy
import numpy as np
import pytest
from drawn_room import grid_from_text
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.srv import LoadMapResponse
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Header

from nav_bundle.base.conversions import (
    ScanMessage,
    message_from_pose,
    pose_from_message,
    quaternion_from_yaw,
    scan_from_message,
    stamped_from_pose,
    yaw_from_quaternion,
)
from nav_bundle.base.error import MapError, MessageError, ObservationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Scan
from nav_bundle.base.transform import Transform
from nav_bundle.control.conversions import velocity_from_odometry
from nav_bundle.costmap.conversions import points_from_cloud, points_from_scan
from nav_bundle.localisation.conversions import (
    ParticlesMessage,
    covariance_from_message,
    covariance_message,
)
from nav_bundle.maps.conversions import (
    GetMapArrayResponse,
    GridMessage,
    LoadMapArrayResponse,
    grid_from_message,
    message_from_grid,
)
from nav_bundle.maps.grid import Grid

STAMP = genpy.Time(3, 4)


def serialised(message: genpy.Message) -> bytes:
    buffer = io.BytesIO()
    buffer.write(b"head")  # rospy serialises after the message's length field
    message.serialize(buffer)
    return buffer.getvalue()[4:]


def small_grid() -> Grid:
    return grid_from_text(["#.?", ".#."], 0.05, Pose(-1.0, 2.0, 0.5))


def test_an_array_map_is_written_as_genpy_writes_it() -> None:
    message = message_from_grid(small_grid(), "/map", STAMP)
    plain = OccupancyGrid(message.header, message.info, message.data.tolist())
    assert message.header.frame_id == "map"
    assert serialised(message) == serialised(plain)
    assert (GridMessage._md5sum, GridMessage._type) == (
        plain._md5sum,
        plain._type,
    )


def test_a_map_survives_the_wire() -> None:
    sent = serialised(message_from_grid(small_grid(), "map", STAMP))
    for received in (
        GridMessage().deserialize(sent),
        OccupancyGrid().deserialize(sent),
    ):
        grid = grid_from_message(received)
        assert grid.resolution == 0.05
        assert math.isclose(grid.origin.yaw, 0.5)
        assert (grid.cells == small_grid().cells).all()


def test_a_map_response_is_the_map() -> None:
    response = GetMapArrayResponse(message_from_grid(small_grid(), "map", STAMP))
    received = GetMapArrayResponse().deserialize(serialised(response))
    assert received.map.data.tolist() == small_grid().cells.ravel().tolist()


def test_a_map_of_sixteen_million_cells_is_quick() -> None:
    grid = Grid(0.05, Pose(-100, -100), np.zeros((4000, 4000), np.int8))
    start = time.process_time()
    sent = serialised(message_from_grid(grid, "map", STAMP))
    grid_from_message(GridMessage().deserialize(sent))
    assert time.process_time() - start < 1.0


def test_a_map_with_cells_missing_is_refused() -> None:
    message = message_from_grid(small_grid(), "map", STAMP)
    message.info.width = 4
    with pytest.raises(MapError, match="the map has 6 cells, expected 4 x 2"):
        grid_from_message(message)


def test_a_scan_is_read_as_arrays() -> None:
    sent = serialised(LaserScan(ranges=[1.0, math.inf, 2.5], range_max=30.0))
    received = ScanMessage().deserialize(sent)
    assert received.ranges.tolist() == [1.0, math.inf, 2.5]
    assert received.range_max == 30.0


@pytest.mark.parametrize("yaw", [-3.0, -0.5, 0.0, 1.0, 3.1])
def test_a_pose_survives_its_message(yaw: float) -> None:
    pose = pose_from_message(message_from_pose(Pose(1.0, -2.0, yaw)))
    assert np.allclose([pose.x, pose.y, pose.yaw], [1.0, -2.0, yaw])
    stamped = stamped_from_pose(pose, "/map", STAMP)
    assert (stamped.header.frame_id, stamped.header.stamp) == ("map", STAMP)


def test_a_quaternion_of_any_length_has_a_heading() -> None:
    quaternion = quaternion_from_yaw(1.2)
    quaternion.z, quaternion.w = 3 * quaternion.z, 3 * quaternion.w
    assert math.isclose(yaw_from_quaternion(quaternion), 1.2)


def test_particles_are_written_as_poses() -> None:
    particles = np.array([[1.0, 2.0, 0.5], [-1.0, 0.0, -3.0]])
    received = PoseArray().deserialize(serialised(ParticlesMessage(particles, "/map", STAMP)))
    assert received.header.frame_id == "map"
    poses = [pose_from_message(pose) for pose in received.poses]
    assert np.allclose([[pose.x, pose.y, pose.yaw] for pose in poses], particles)


def test_a_load_response_is_written_as_genpy_writes_it() -> None:
    message = message_from_grid(small_grid(), "map", STAMP)
    sent = serialised(LoadMapArrayResponse(message, 2))
    received = LoadMapResponse().deserialize(sent)
    assert (received.result, list(received.map.data)) == (2, small_grid().cells.ravel().tolist())


def test_a_covariance_survives_its_message() -> None:
    covariance = np.array([[1.0, 0.2, 0.0], [0.2, 2.0, 0.1], [0.0, 0.1, 3.0]])
    message = PoseWithCovarianceStamped()
    message.pose.covariance = covariance_message(covariance)
    assert (covariance_from_message(message) == covariance).all()


def test_a_laser_mounted_upside_down_turns_the_other_way() -> None:
    message = LaserScan(range_max=5.0, angle_min=-1.0, angle_increment=0.5, ranges=[1.0, 2.0])
    rolled = Transform((0.1, 0.0, 0.2), (1.0, 0.0, 0.0, 0.0))
    scan = scan_from_message(message, rolled)
    assert (scan.angle_min, scan.angle_increment) == (1.0, -0.5)
    upright = scan_from_message(message, Transform())
    assert (upright.angle_min, upright.angle_increment) == (-1.0, 0.5)


def cloud_of(
    points: NDArray[np.float64], order: str = "<", kind: str = "f4", code: int = PointField.FLOAT32
) -> PointCloud2:
    """Returns a cloud with eight bytes before the coordinates and padding after each row."""
    size = np.dtype(kind).itemsize
    fields = [PointField(name, 8 + size * i, code, 1) for i, name in enumerate("xyz")]
    step = 8 + 3 * size
    rows, cols = points.shape[:2]
    raw = np.zeros((rows, cols * step + 5), np.uint8)
    values = points.astype(order + kind).view(np.uint8).reshape(rows, cols, 3 * size)
    raw[:, : cols * step].reshape(rows, cols, step)[:, :, 8:] = values
    return PointCloud2(
        Header(), rows, cols, fields, order == ">", step, cols * step + 5, raw.tobytes(), False
    )


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("kind", "code"), [("f4", PointField.FLOAT32), ("f8", PointField.FLOAT64)])
def test_a_cloud_s_points_are_read_whatever_its_layout(order: str, kind: str, code: int) -> None:
    points = np.arange(18.0).reshape(2, 3, 3)
    points[1, 1, 2] = np.nan
    expected = np.delete(points.reshape(-1, 3), 4, axis=0)
    np.testing.assert_array_equal(points_from_cloud(cloud_of(points, order, kind, code)), expected)


def test_a_cloud_that_lacks_fields_or_bytes_is_refused() -> None:
    cloud = cloud_of(np.zeros((1, 2, 3)))
    cloud.data = cloud.data[:-9]
    with pytest.raises(ObservationError, match="bytes"):
        points_from_cloud(cloud)
    cloud.fields = cloud.fields[:2]
    with pytest.raises(ObservationError, match="x, y, z"):
        points_from_cloud(cloud)


def test_a_cloud_without_points_has_none() -> None:
    assert points_from_cloud(cloud_of(np.zeros((0, 0, 3)))).shape == (0, 3)


BAD_NUMBERS = [math.nan, math.inf, -math.inf, 1.0e200]


@pytest.mark.parametrize("number", BAD_NUMBERS)
@pytest.mark.parametrize("field", ["position.x", "position.z", "orientation.x", "orientation.w"])
def test_a_pose_with_a_number_out_of_range_is_refused_by_name(field: str, number: float) -> None:
    message = message_from_pose(Pose())
    part, name = field.split(".")
    setattr(getattr(message, part), name, number)
    with pytest.raises(MessageError, match=f"{field} must be a number within"):
        pose_from_message(message)


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_a_map_with_an_origin_or_resolution_out_of_range_is_refused(number: float) -> None:
    message = message_from_grid(small_grid(), "map", STAMP)
    message.info.origin.orientation.z = number
    with pytest.raises(MessageError, match=r"map refused: origin.orientation.z"):
        grid_from_message(message)
    message.info.origin.orientation.z, message.info.resolution = 0.0, number
    with pytest.raises(MessageError, match="map refused: resolution"):
        grid_from_message(message)


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_odometry_with_a_speed_out_of_range_is_refused(number: float) -> None:
    message = Odometry()
    message.twist.twist.angular.z = number
    with pytest.raises(MessageError, match=r"odometry refused: angular.z"):
        velocity_from_odometry(message)


@pytest.mark.parametrize("number", BAD_NUMBERS[:3])
def test_an_initial_pose_with_a_covariance_that_is_not_finite_is_refused(number: float) -> None:
    message = PoseWithCovarianceStamped()
    message.pose.covariance = [0.0] * 35 + [number]
    with pytest.raises(MessageError, match=r"covariance\[35\]"):
        covariance_from_message(message)


@pytest.mark.parametrize("field", ["angle_min", "angle_increment", "range_min", "range_max"])
def test_a_scan_whose_geometry_is_not_a_number_is_refused(field: str) -> None:
    message = LaserScan(range_max=10.0, ranges=[1.0, math.nan, math.inf])
    assert len(points_from_scan(message, False)) == 1
    setattr(message, field, math.nan)
    for convert in (lambda: points_from_scan(message, True), lambda: scan_of(message)):
        with pytest.raises(ObservationError, match="scan refused"):
            convert()


def scan_of(message: LaserScan) -> Scan:
    return scan_from_message(message, Transform())


def test_a_pose_without_a_rotation_has_heading_zero() -> None:
    assert pose_from_message(PoseMessage()) == Pose()
