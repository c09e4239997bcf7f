"""``spawn_model``: adds a model to the running simulator, with the arguments of gazebo_ros' script."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import rospy
from gazebo_msgs.srv import (
    DeleteModel,
    GetWorldProperties,
    SetModelConfiguration,
    SetModelConfigurationRequest,
    SpawnModel,
    SpawnModelRequest,
)
from geometry_msgs.msg import Point, Pose, Quaternion
from std_srvs.srv import Empty

from pioneer_gazebo.error import SimulatorError, SpawnError
from pioneer_gazebo.fleet.drawn_map import read_map
from pioneer_gazebo.fleet.fleet import InitialPose, check_place, initial_pose
from pioneer_gazebo.fleet.pose_file import poses_of_world, read_poses
from pioneer_gazebo.world.element import Notes
from pioneer_gazebo.world.pose import quaternion_from_rpy
from pioneer_gazebo.world.resource import map_path, model_path, world_path
from pioneer_gazebo.world.sdf import model_file

WAIT_WORDS_PERIOD = 5.0
"""Interval between log lines while waiting [s]."""


def parser() -> argparse.ArgumentParser:
    """Returns the argument parser."""
    result = argparse.ArgumentParser(prog="spawn_model", description=__doc__)
    form = result.add_mutually_exclusive_group(required=True)
    form.add_argument("-urdf", action="store_true", help="the model is URDF")
    form.add_argument("-sdf", action="store_true", help="the model is SDF")
    source = result.add_mutually_exclusive_group(required=True)
    source.add_argument("-param", metavar="NAME", help="read the model from a ROS parameter")
    source.add_argument("-file", type=Path, metavar="FILE", help="read the model from a file")
    source.add_argument(
        "-database",
        metavar="NAME",
        help="read the model NAME along the model path (GAZEBO_MODEL_PATH)",
    )
    source.add_argument("-stdin", action="store_true", help="read the model from standard input")
    result.add_argument("-model", required=True, metavar="NAME", help="name of the model")
    result.add_argument(
        "-robot_namespace", default=None, metavar="NS", help="of its topics (default: this node's)"
    )
    result.add_argument(
        "-reference_frame", default="", metavar="NAME", help="of the pose (default: the world)"
    )
    result.add_argument(
        "-gazebo_namespace", default="/gazebo", metavar="NS", help="of the simulator's services"
    )
    result.add_argument(
        "-J",
        dest="joints",
        action="append",
        nargs=2,
        default=[],
        metavar=("JOINT", "POSITION"),
        help="put a joint at a position [rad or m]; may be given several times",
    )
    result.add_argument(
        "-b", dest="bond", action="store_true", help="stay, and delete the model at the end"
    )
    result.add_argument(
        "-package_to_model",
        action="store_true",
        help="without effect: package:// in a model is found as it is",
    )
    result.add_argument("-unpause", action="store_true", help="unpause the simulation afterwards")
    result.add_argument("-wait", metavar="MODEL", help="wait until this model exists")
    result.add_argument(
        "-timeout", type=float, default=float("inf"), help="give up waiting after so many seconds"
    )
    result.add_argument("-world", metavar="WORLD", help="check the place against this world's map; what is left out of "
        "x, y and Y is pioneer1's in that world")  # fmt: skip
    for name, text in (
        ("x", "[m]"),
        ("y", "[m]"),
        ("z", "[m]"),
        ("R", "[rad]"),
        ("P", "[rad]"),
        ("Y", "[rad]"),
    ):
        result.add_argument(f"-{name}", type=float, dest=f"pose_{name}", help=f"{text} (default 0)")
    return result


def place_of(options: argparse.Namespace) -> InitialPose:
    """Returns the pose at which to spawn the model.

    Raises:
        SimulatorError: with ``-world``, no robot can start there.
    """
    default, path = InitialPose(0.0, 0.0, 0.0), None
    if options.world:
        path = world_path(options.world)
        poses = poses_of_world(path.stem)
        default = initial_pose(read_poses(poses), "pioneer1", str(poses))
    given = (options.pose_x, options.pose_y, options.pose_Y)
    known = (default.x, default.y, default.a)
    place = InitialPose(
        *(one if value is None else value for value, one in zip(given, known, strict=True))
    )
    if path and (grid := map_path(path)).is_file():
        check_place(read_map(grid), options.model, place.x, place.y, path.stem)
    return place


def model_xml(options: argparse.Namespace) -> str:
    """Returns the model's XML text.

    Raises:
        SpawnError: the file or parameter does not exist or cannot be read.
    """
    if options.stdin:
        return _decoded(sys.stdin.buffer.read(), "standard input")
    if options.file is not None:
        return _text_of(options.file)
    if options.database is not None:
        return _text_of(database_file(options.database))
    try:
        return str(rospy.get_param(options.param))
    except KeyError:
        raise SpawnError(f"there is no parameter {options.param}") from None


def _text_of(file: Path) -> str:
    try:
        data = file.read_bytes()
    except OSError as error:
        raise SpawnError(f"cannot read {file}: {error.strerror}") from error
    return _decoded(data, str(file))


def _decoded(data: bytes, source: str) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise SpawnError(f"{source} is not UTF-8: {error.reason} at byte {error.start}") from None


def database_file(name: str) -> Path:
    """Returns the SDF file of a model on the model path.

    Raises:
        SpawnError: there is no such model; the message says where it was searched.
    """
    folders = model_path()
    found = next((folder / name for folder in folders if (folder / name).is_dir()), None)
    if found is None:
        searched = ", ".join(map(str, folders))
        raise SpawnError(f"no model {name} in {searched}: put it there, or set GAZEBO_MODEL_PATH")
    return model_file(found, Notes())


def joint_positions(words: Sequence[Sequence[str]]) -> dict[str, float]:
    """Returns the positions [rad or m] of ``-J JOINT POSITION``.

    Raises:
        SpawnError: a position is no number.
    """
    positions: dict[str, float] = {}
    for joint, text in words:
        try:
            positions[joint] = float(text)
        except ValueError:
            raise SpawnError(f"-J {joint}: {text!r} is no number") from None
    return positions


def wait_for_service(name: str, timeout: float) -> None:
    """Waits for a service, logging that it waits.

    Raises:
        SpawnError: the service did not appear within ``timeout`` [s].
    """
    waited = 0.0
    while waited < timeout:
        step = min(WAIT_WORDS_PERIOD, timeout - waited)
        try:
            rospy.wait_for_service(name, step)
        except rospy.ROSInterruptException:
            raise
        except rospy.ROSException:
            waited += step
            rospy.loginfo("waiting for %s", name)
        else:
            return
    raise SpawnError(f"{name} did not come within {timeout:g} s")


def wait_for_model(options: argparse.Namespace) -> None:
    """Waits until the model given by ``-wait`` is in the world."""
    name = f"{options.gazebo_namespace}/get_world_properties"
    wait_for_service(name, options.timeout)
    world = rospy.ServiceProxy(name, GetWorldProperties, persistent=True)
    rospy.loginfo("waiting for model %s", options.wait)
    pause = rospy.Rate(10)
    while options.wait not in world().model_names:
        pause.sleep()


def spawn(options: argparse.Namespace) -> None:
    """Spawns the model.

    Raises:
        SpawnError: the model's text cannot be read, or the simulator refused the request.
        SimulatorError: no robot can start there.
    """
    positions = joint_positions(options.joints)
    place = place_of(options)
    namespace = (
        rospy.get_namespace() if options.robot_namespace is None else options.robot_namespace
    )
    rotation = quaternion_from_rpy(options.pose_R or 0.0, options.pose_P or 0.0, place.a)
    pose = Pose(Point(place.x, place.y, options.pose_z or 0.0), Quaternion(*rotation))
    request = SpawnModelRequest(
        options.model, model_xml(options), namespace, pose, options.reference_frame
    )
    if options.wait:
        wait_for_model(options)
    name = f"{options.gazebo_namespace}/spawn_{'urdf' if options.urdf else 'sdf'}_model"
    wait_for_service(name, options.timeout)
    response = rospy.ServiceProxy(name, SpawnModel)(request)
    if not response.success:
        raise SpawnError(response.status_message)
    rospy.loginfo("%s", response.status_message)
    if positions:
        _set_joints(options, positions)
    if options.unpause:
        rospy.ServiceProxy(f"{options.gazebo_namespace}/unpause_physics", Empty)()


def _set_joints(options: argparse.Namespace, positions: Mapping[str, float]) -> None:
    """Puts the model's joints at their positions.

    Raises:
        SpawnError: the model has no such joint; it stays in the world.
    """
    name = f"{options.gazebo_namespace}/set_model_configuration"
    request = SetModelConfigurationRequest(options.model, "", [*positions], [*positions.values()])
    response = rospy.ServiceProxy(name, SetModelConfiguration)(request)
    if not response.success:
        raise SpawnError(f"it is spawned, but {response.status_message}")


def delete_at_the_end(options: argparse.Namespace) -> None:
    """Waits for this node's end, and deletes the model."""
    rospy.loginfo("%s is deleted when this ends (Ctrl-C)", options.model)
    delete = rospy.ServiceProxy(f"{options.gazebo_namespace}/delete_model", DeleteModel)
    rospy.on_shutdown(lambda: delete(options.model))
    rospy.spin()


def main() -> int:
    """Runs the script; returns the exit status: 0 if the model was spawned."""
    options = parser().parse_args(rospy.myargv()[1:])
    rospy.init_node("spawn_model", anonymous=True, disable_rostime=True)
    try:
        spawn(options)
    except rospy.ROSInterruptException:
        return 130
    except (SimulatorError, rospy.ServiceException) as error:
        rospy.logerr("%s not spawned: %s", options.model, error)
        return 1
    if options.bond:
        delete_at_the_end(options)
    return 0
