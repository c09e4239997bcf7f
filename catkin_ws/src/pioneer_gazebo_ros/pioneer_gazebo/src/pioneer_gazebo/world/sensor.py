"""Reads a link's sensors, with the names and elements used by Gazebo and gazebo_ros."""

from collections.abc import Callable
from typing import Any

from pioneer_gazebo.world.element import Element, Notes, library_of
from pioneer_gazebo.world.plugin import imu_of, in_own_namespace, note_unread
from pioneer_gazebo.world.robot import Bumper, Camera, Device, LaserSensor, SonarSensor

IMU_PLUGINS = ("gazebo_ros_imu_sensor", "gazebo_ros_imu")
READ = {
    "topicName", "frameName", "updateRate", "fov", "radiation", "gaussianNoise", "cameraName", "imageTopicName",
    "cameraInfoTopicName", "hackBaseline", "bumperTopicName", "ros", "output_type", "frame_name", "depthImageTopicName",
    "pointCloudTopicName", "depthImageCameraInfoTopicName", "pointCloudCutoff", "pointCloudCutoffMax",
    "distortionK1", "distortionK2", "distortionK3", "distortionT1", "distortionT2", "Cx", "CxPrime", "Cy",
    "focalLength", "baseline",
}  # fmt: skip
"""Elements of sensor plugins that are read or have no effect here; images have no distortion."""
_LENS = {
    "distortionK1", "distortionK2", "distortionK3", "distortionT1", "distortionT2", "Cx", "CxPrime", "Cy",
    "focalLength",
}  # fmt: skip
"""Elements of camera plugins that have no effect here unless they are 0."""
DEPTH_PLUGINS = ("gazebo_ros_depth_camera", "gazebo_ros_openni_kinect")
PIXEL_FORMATS = ("R8G8B8", "B8G8R8", "L8", "RGB_INT8", "BGR_INT8", "L_INT8")


def read_sensor(element: Element, link: str, notes: Notes) -> list[Device]:
    """Returns the device of a ``<sensor>`` on ``link``; empty, with a note, if it is not supported.

    Raises:
        DescriptionError: a value is invalid.
    """
    plugin = element.child("plugin")
    if (
        element.attribute("type", "") == "imu"
        and plugin is not None
        and library_of(plugin) in IMU_PLUGINS
    ):
        return in_own_namespace(plugin, [imu_of(plugin, link, None, notes)])
    if plugin is None:
        notes.add(
            f"sensor {element.attribute('name')!r} is ignored: it has no plugin that would publish it"
        )
        return []
    reader = _SENSORS.get(library_of(plugin))
    if reader is None:
        notes.add(f"sensor plugin lib{library_of(plugin)}.so is not supported and ignored")
        return []
    note_unread(plugin, READ, notes)
    for child in plugin.children():
        if child.tag in _LENS and child.text not in ("", "0", "0.0"):
            child.note(
                notes, "is ignored: images have no distortion, and the lens is that of <camera>"
            )
    return in_own_namespace(plugin, [reader(element, plugin, link)])


def _common(element: Element, link: str) -> dict[str, Any]:
    rate = element.number("update_rate", 0.0)
    if rate < 0:
        raise element.needed("update_rate").error("must not be below 0")
    return {
        "name": element.attribute("name"),
        "link": link,
        "pose": element.placed(),
        "update_rate": rate,
    }


def _ray(element: Element) -> tuple[Element, dict[str, Any]]:
    """Returns ``<horizontal>`` and the settings common to all ray sensors."""
    ray = element.needed("ray")
    horizontal = ray.needed("scan").needed("horizontal")
    reach = ray.needed("range")
    near, far = reach.number("min"), reach.positive("max")
    if not 0 <= near < far:
        raise reach.error(f"min must be between 0 and max, not {near:g} with max {far:g}")
    samples = horizontal.integer("samples")
    if samples < 1:
        raise horizontal.needed("samples").error(f"must be 1 or more, not {samples}")
    return horizontal, {"samples": samples, "min_range": near, "max_range": far}


def _laser(element: Element, plugin: Element, link: str) -> LaserSensor:
    horizontal, shared = _ray(element)
    lowest, highest = horizontal.number("min_angle"), horizontal.number("max_angle")
    if lowest > highest:
        raise horizontal.error(f"min_angle {lowest:g} is above max_angle {highest:g}")
    return LaserSensor(
        **_common(element, link),
        **shared,
        min_angle=lowest,
        max_angle=highest,
        noise_mean=element.number("ray/noise/mean", 0.0),
        noise_stddev=element.number("ray/noise/stddev", 0.0),
        topic=plugin.word("topicName", _remapped(plugin) or "base_scan"),
        frame=plugin.word("frameName", plugin.word("frame_name", link)),
    )


def _remapped(plugin: Element) -> str:
    """Returns the topic that ``libgazebo_ros_ray_sensor.so`` is remapped to; empty for none."""
    ros = plugin.child("ros")
    names = [] if ros is None else [child.text for child in ros.children("remapping")]
    return next((name.partition(":=")[2] for name in names if name.startswith("~/out:=")), "")


def _sonar(element: Element, plugin: Element, link: str) -> SonarSensor:
    horizontal, shared = _ray(element)
    common = _common(element, link)
    common["update_rate"] = plugin.number("updateRate", common["update_rate"])
    opening = horizontal.number("max_angle") - horizontal.number("min_angle")
    return SonarSensor(
        **common,
        **shared,
        fov=plugin.number("fov", opening),
        radiation=plugin.word("radiation", "ultrasound"),
        gaussianNoise=plugin.number("gaussianNoise", 0.0),
        topic=plugin.word("topicName", "sonar"),
        frame=plugin.word("frameName", link),
    )


def _camera(element: Element, plugin: Element, link: str) -> Camera:
    camera = element.needed("camera")
    image = camera.needed("image")
    common = _common(element, link)
    width, height = image.integer("width"), image.integer("height")
    if min(width, height) < 1:
        raise image.error(f"width and height must be 1 or more, not {width} and {height}")
    pixels = image.word("format", "R8G8B8")
    if pixels not in PIXEL_FORMATS:
        raise image.needed("format").error(
            f"must be one of {', '.join(PIXEL_FORMATS)}, not {pixels!r}"
        )
    return Camera(
        name=plugin.word("cameraName", common["name"]),
        link=link,
        pose=common["pose"].compose(camera.placed()),
        update_rate=plugin.number("updateRate", 0.0) or common["update_rate"],
        horizontal_fov=camera.positive("horizontal_fov", 1.047),
        width=width,
        height=height,
        near=camera.positive("clip/near", 0.1),
        far=camera.positive("clip/far", 100.0),
        format=pixels,
        noise_stddev=camera.number("noise/stddev", 0.0),
        image_topic=plugin.word("imageTopicName", "image_raw"),
        info_topic=plugin.word("cameraInfoTopicName", "camera_info"),
        hack_baseline=plugin.number("hackBaseline", 0.0),
        frame=plugin.word("frameName", link),
        **_depth_topics(element, plugin),
    )


def _depth_topics(element: Element, plugin: Element) -> dict[str, str]:
    if element.attribute("type", "") != "depth" and library_of(plugin) not in DEPTH_PLUGINS:
        return {}
    return {
        "depth_topic": plugin.word("depthImageTopicName", "depth/image_raw"),
        "depth_info_topic": plugin.word("depthImageCameraInfoTopicName", "depth/camera_info"),
        "cloud_topic": plugin.word("pointCloudTopicName", "points"),
    }


def _bumper(element: Element, plugin: Element, link: str) -> Bumper:
    common = _common(element, link)
    return Bumper(
        name=common["name"],
        link=link,
        collision=element.word("contact/collision", ""),
        bumperTopicName=plugin.word("bumperTopicName", "bumper"),
        frameName=plugin.word("frameName", "map"),
        update_rate=common["update_rate"],
    )


_SENSORS: dict[str, Callable[[Element, Element, str], Device]] = {
    "gazebo_ros_laser": _laser,
    "gazebo_ros_gpu_laser": _laser,
    "gazebo_ros_ray_sensor": _laser,
    "gazebo_ros_range": _sonar,
    "gazebo_ros_camera": _camera,
    "gazebo_ros_depth_camera": _camera,
    "gazebo_ros_openni_kinect": _camera,
    "gazebo_ros_bumper": _bumper,
}
