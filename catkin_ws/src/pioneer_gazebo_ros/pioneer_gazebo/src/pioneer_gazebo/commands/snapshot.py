"""``snapshot``: saves a top-down image of the running simulation as PNG."""
# ruff: noqa: T201 - a command prints to standard output

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rosgraph
import rospy
from gazebo_msgs import srv
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from pioneer_gazebo.body.body import body_from_model, body_from_robot
from pioneer_gazebo.commands.plan_image import PlanImage, Shown
from pioneer_gazebo.commands.world_to_map import LASER_HEIGHT
from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.ros import messages
from pioneer_gazebo.simulation.scene import outline_of
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.resource import model_path, world_path
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_gazebo.world.section import Section, section_of
from pioneer_gazebo.world.urdf import robot_from_urdf

PATIENCE = 3.0
"""Time limit for a service or a scan [s of wall time]."""

BLIND: NDArray[np.float64] = np.empty((0, 2))
NO_OUTLINE: NDArray[np.float64] = np.empty((0, 4))


class SnapshotError(SimulatorError):
    """There is no simulation to draw."""


class Snapshot:
    """Queries everything to be drawn from the simulation.

    Subscribes: every sensor_msgs/LaserScan below a model's name, for one message.

    Services called: ``/gazebo/get_world_properties``, ``get_model_properties``, ``get_model_state`` and
        ``get_link_state``.

    Parameters: ``/gazebo/world_name``, ``/robot_description``.

    On error: `SnapshotError`, `DescriptionError`; a missing scan is reported, and scans are omitted.
    """

    def __init__(self) -> None:
        self._world = self._service("get_world_properties", srv.GetWorldProperties)
        self._properties = self._service("get_model_properties", srv.GetModelProperties)
        self._model = self._service("get_model_state", srv.GetModelState)
        self._link = self._service("get_link_state", srv.GetLinkState)
        self._silent = False
        self._file = world_from_sdf(
            world_path(rospy.get_param("/gazebo/world_name", "utm_0")), model_path()
        )
        self._scans = [
            topic for topic, kind in rospy.get_published_topics() if kind == "sensor_msgs/LaserScan"
        ]

    @staticmethod
    def _service(name: str, kind: type) -> rospy.ServiceProxy:
        try:
            rospy.wait_for_service(f"/gazebo/{name}", PATIENCE)
        except rospy.ROSException:
            raise SnapshotError(
                f"no simulator serves /gazebo/{name} at {rosgraph.get_master_uri()}"
            ) from None
        return rospy.ServiceProxy(f"/gazebo/{name}", kind)

    def solids(self) -> list[Section]:
        """Returns the section at laser height of each solid in the world file."""
        return [
            section_of(one.collision.shape, one.pose, LASER_HEIGHT, triangles_of_mesh)
            for one in self._file.collisions(static_only=True)
        ]

    def shown(self) -> list[Shown]:
        """Returns all moving models in the order of spawning."""
        names = self._world().model_names
        moving = [name for name in names if not self._properties(name).is_static]
        text = rospy.get_param("/robot_description", "")
        self._robot = body_from_robot(robot_from_urdf(text), triangles_of_mesh) if text else None
        self._bodies = {
            model.name: body_from_model(model, triangles_of_mesh) for model in self._file.models
        }
        return [self._shown(name) for name in moving]

    def _outline(self, name: str, z: float) -> NDArray[np.float64]:
        """Returns a model's outline at laser height, of a robot at that of its own laser; empty if unknown."""
        if name in self._bodies:
            return outline_of(self._bodies[name], LASER_HEIGHT - z, triangles_of_mesh)
        return (
            NO_OUTLINE
            if self._robot is None
            else outline_of(self._robot, LASER_HEIGHT, triangles_of_mesh)
        )

    def _shown(self, name: str) -> Shown:
        pose = messages.pose_from_message(self._model(name, "").pose)
        x, y, z = pose.position
        hits, eye = BLIND, (x, y)
        topic = next((topic for topic in self._scans if topic.startswith(f"/{name}/")), None)
        if topic is not None and not self._silent:
            try:
                scan = rospy.wait_for_message(topic, LaserScan, PATIENCE)
                sensor = self._sensor(name, scan.header.frame_id, pose)
                hits, eye = ends(scan, sensor), sensor.position[:2]
            except rospy.ROSException:
                print(
                    f"snapshot: {topic} brings no scan (is time paused?): drawn without scans",
                    file=sys.stderr,
                )
                self._silent = True
        return Shown(name, x, y, pose.yaw, self._outline(name, z), hits, eye)

    def _sensor(self, name: str, frame: str, base: Pose) -> Pose:
        """Returns the pose of a scan's frame, or that of the base if no link has that name."""
        answer = self._link(f"{name}::{frame.rpartition('/')[2]}", "")
        return messages.pose_from_message(answer.link_state.pose) if answer.success else base


def ends(scan: LaserScan, sensor: Pose) -> NDArray[np.float64]:
    """Returns the end points of a scan's beams, shape (n, 2) in the world [m], without beams that hit nothing."""
    ranges = np.asarray(scan.ranges)
    angles = sensor.yaw + scan.angle_min + np.arange(len(ranges)) * scan.angle_increment
    met = np.isfinite(ranges)
    x, y, _ = sensor.position
    return np.column_stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)])[met]


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line and writes the image; returns the exit status."""
    words = rospy.myargv(sys.argv)[1:] if argv is None else argv
    parser = argparse.ArgumentParser(
        "snapshot", description="Draws the running simulation from above."
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("snapshot.png"), help="default: %(default)s"
    )
    parser.add_argument(
        "--size", type=int, default=1200, help="of the longer side [pixels] (default %(default)s)"
    )
    options = parser.parse_args(words)
    if not 100 <= options.size <= 20000:
        parser.error(f"--size must be 100 to 20000 pixels, not {options.size}")
    if not rosgraph.is_master_online():
        print(f"snapshot: no ROS master at {rosgraph.get_master_uri()}", file=sys.stderr)
        return 1
    rospy.init_node("snapshot", anonymous=True, disable_signals=True, disable_rostime=True)
    try:
        snapshot = Snapshot()
        shown = snapshot.shown()
        PlanImage(snapshot.solids(), shown, options.size).image.save(options.output, "PNG")
    except (SimulatorError, rospy.ServiceException, OSError) as error:
        print(f"snapshot: {error}", file=sys.stderr)
        return 1
    finally:
        rospy.signal_shutdown("done")
    print(f"{options.output}: {len(shown)} models that move")
    return 0
