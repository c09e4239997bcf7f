"""The amcl node: adaptive Monte Carlo localisation with the interface of ROS Noetic's amcl."""

import functools
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovariance, PoseWithCovarianceStamped
from nav_msgs.srv import SetMapResponse
from std_msgs.msg import Header
from std_srvs.srv import Empty, EmptyResponse

from nav_bundle.base.clock import ClockWatch, Jump
from nav_bundle.base.conversions import (
    ScanMessage,
    message_from_pose,
    pose_from_message,
    scan_from_message,
)
from nav_bundle.base.error import NavigationError, ObservationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Scan
from nav_bundle.base.topics import TransformBroadcaster, TransformListener, robot_frame
from nav_bundle.base.transform import TransformError
from nav_bundle.localisation.config import UNSUPPORTED, AmclConfig
from nav_bundle.localisation.conversions import (
    ParticlesMessage,
    covariance_from_message,
    covariance_message,
)
from nav_bundle.localisation.correction_file import (
    Correction,
    CorrectionFile,
    CorrectionFileError,
    has_continued,
)
from nav_bundle.localisation.localisation import Localisation, NoMapError
from nav_bundle.localisation.particle_filter import Estimate
from nav_bundle.localisation.topics import PoseStore, deviation_status
from nav_bundle.maps.conversions import (
    GridMessage,
    SetMapArray,
    SetMapArrayRequest,
    grid_from_message,
)
from nav_bundle.maps.services import fetch_map
from pioneer_node.core.frame import stripped
from pioneer_node.core.live import Value
from pioneer_node.core.parameter import ParameterError, config_from_mapping
from pioneer_node.nodes import entry
from pioneer_node.nodes.reconfigure import ReconfigureServer
from pioneer_node.nodes.standing_warning import StandingWarning

DIAGNOSIS_PERIOD = 1.0
"""Time [s] between two messages on /diagnostics."""
REMEMBERED_COVARIANCE = np.diag([0.1**2, 0.1**2, 0.05**2])
"""Covariance of a pose restored from ~correction_file: x, y [m²] and heading [rad²]."""


def read_config() -> AmclConfig:
    """Returns the node's parameters; logs one line with those of Noetic's amcl that have no effect here."""
    values = entry.parameters()
    idle = sorted(UNSUPPORTED & values.keys())
    if idle:
        rospy.logwarn("amcl: parameters without effect here: ~%s", ", ~".join(idle))
    return config_from_mapping(AmclConfig, values, "amcl", ignored=UNSUPPORTED)


class AmclNode:
    """Localises a robot in a map from laser scans and odometry.

    Subscribes: ``scan`` (sensor_msgs/LaserScan, of one laser or of several, each in its own frame), ``initialpose``
    (geometry_msgs/PoseWithCovarianceStamped), ``map`` (nav_msgs/OccupancyGrid, with ~use_map_topic), /tf, /tf_static.

    Publishes: ``amcl_pose`` (geometry_msgs/PoseWithCovarianceStamped, latched), ``particlecloud``
    (geometry_msgs/PoseArray, latched), /tf (map to odom), ``/diagnostics`` (diagnostic_msgs/DiagnosticArray, once per
    second while scans arrive).

    Services: ``global_localization``, ``request_nomotion_update`` (std_srvs/Empty), ``set_map`` (nav_msgs/SetMap).
    Calls ``static_map`` (nav_msgs/GetMap) without ~use_map_topic.

    Parameters: ``AmclConfig``; ``Live`` ones can be changed at run time (``ReconfigureServer``). ``tf_prefix`` applies
    to the robot's frames, not to the map's.

    Threads: callbacks store the newest scans or queue a command; ``spin`` does all the work.

    On error: scans without map or transforms are dropped with a warning that names what is missing. An invalid
    parameter ends the node, an unreadable ~correction_file does not. When simulated time starts again, so
    does localisation, at the initial pose; a clock that is set back changes nothing.
    """

    def __init__(self) -> None:
        self._config = config = read_config()
        self._localisation = Localisation(config, np.random.default_rng(config.seed))
        self._store = PoseStore(config.save_pose_rate)
        self._arrived = threading.Condition()
        self._newest: dict[str, ScanMessage] = {}  # the newest scan of each laser, by its frame
        self._commands: deque[Callable[[], None]] = deque()
        self._estimate: Estimate | None = None
        self._map_from_odom: Pose | None = None
        self._clock = ClockWatch(simulated=not rospy.rostime.is_wallclock())
        self._next_cloud = self._next_diagnosis = 0.0
        self._lost = False
        self._dropping = StandingWarning("scans are used now")
        self._start_at_initial_pose()
        self._listener = TransformListener(future_limit=config.transform_future_limit)
        self._map_frame, self._odom_frame, self._base_frame = self._listen()
        self._correction = CorrectionFile(config.correction_file)
        self._remembered = self._read_correction()
        self._kept: Estimate | None = None  # the last one whose correction was written
        self._unkept = StandingWarning("the pose is remembered again")
        self._broadcaster = TransformBroadcaster()
        self._pose_publisher = rospy.Publisher(
            "amcl_pose", PoseWithCovarianceStamped, queue_size=2, latch=True
        )
        self._cloud_publisher = rospy.Publisher(
            "particlecloud", PoseArray, queue_size=2, latch=True
        )
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        self._serve()
        self._maps = self._ask_for_map()
        rospy.Subscriber(
            "initialpose",
            PoseWithCovarianceStamped,
            self._queued(self._set_initial_pose),
            queue_size=2,
        )
        self._scans = rospy.Subscriber(
            "scan", ScanMessage, self._on_scan, queue_size=10, tcp_nodelay=True
        )
        self._reconfiguration = ReconfigureServer(
            "~", config, self._on_reconfigure, (ParameterError,)
        )
        entry.on_shutdown(lambda: self._post(lambda: None))

    def _listen(self) -> tuple[str, str, str]:
        """Starts listening to odometry transforms; returns the frame names of map, odometry and base."""
        config = self._config
        odom, base = robot_frame(config.odom_frame_id), robot_frame(config.base_frame_id)
        self._listener.listen(odom, base)
        return stripped(config.global_frame_id), odom, base

    def _serve(self) -> None:
        rospy.Service(
            "global_localization", Empty, lambda _: self._do(self._scatter, EmptyResponse())
        )
        rospy.Service(
            "request_nomotion_update",
            Empty,
            lambda _: self._do(self._localisation.force_update, EmptyResponse()),
        )
        rospy.Service("set_map", SetMapArray, self._on_set_map)

    def _ask_for_map(self) -> rospy.Subscriber | None:
        """Subscribes to the map and returns the subscriber, or requests the map from the map server in a thread."""
        if self._config.use_map_topic:
            return rospy.Subscriber("map", GridMessage, self._queued(self._set_map), queue_size=1)
        threading.Thread(target=self._fetch_map, name="static_map", daemon=True).start()
        return None

    def _on_scan(self, message: ScanMessage) -> None:
        with self._arrived:
            self._newest[message.header.frame_id] = message
            self._arrived.notify()

    def _queued(self, command: Callable[[Any], None]) -> Callable[[Any], None]:
        return lambda message: self._post(functools.partial(command, message))

    def _on_set_map(self, request: SetMapArrayRequest) -> SetMapResponse:
        def change() -> None:
            self._set_map(request.map, again=True)
            self._set_initial_pose(request.initial_pose)
            if self._config.force_update_after_set_map:
                self._localisation.force_update()

        return self._do(change, SetMapResponse(True))

    def _on_reconfigure(self, changes: dict[str, Value]) -> None:
        config = replace(self._config, **changes)  # type: ignore[arg-type]
        self._do(lambda: self._configure(config), None)
        self._reconfiguration.update(config)

    def _post(self, command: Callable[[], None]) -> None:
        with self._arrived:
            self._commands.append(command)
            self._arrived.notify()

    def _do(self, command: Callable[[], None], response: Any) -> Any:
        """Runs ``command`` in the loop and returns ``response``; a NavigationError becomes a ServiceException."""
        done = threading.Event()
        errors: list[NavigationError] = []

        def run() -> None:
            try:
                command()
            except NavigationError as error:
                errors.append(error)
            done.set()

        self._post(run)
        while not done.wait(0.5):
            if rospy.is_shutdown():
                raise rospy.ServiceException("amcl is shutting down")
        if errors:
            raise rospy.ServiceException(str(errors[0]))
        return response

    # The loop.

    def spin(self) -> None:
        """Processes scans and commands until shutdown."""
        while not rospy.is_shutdown():
            with self._arrived:
                self._arrived.wait_for(
                    lambda: self._commands or self._newest or rospy.is_shutdown()
                )
            self.step()

    def step(self) -> None:
        """Runs the queued commands and processes the newest scan of each laser, the oldest first."""
        with self._arrived:
            commands = list(self._commands)
            scans = sorted(self._newest.values(), key=lambda scan: scan.header.stamp)
            self._commands.clear()
            self._newest.clear()
        for command in commands:
            self._guarded(command)
        for scan in scans:
            self._guarded(functools.partial(self._use_scan, scan))

    def ready(self) -> bool:
        """Returns whether map and the robot's static transforms have arrived; call it from the thread of ``step``."""
        self.step()
        return self._localisation.has_map and self._listener.has_fixed(self._base_frame)

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except NavigationError as error:
            if rospy.is_shutdown():
                return
            if isinstance(error, TransformError | ObservationError | NoMapError):
                self._dropping.warn(f"scans are dropped: {error}")
            else:
                rospy.logwarn("%s", error)

    def _use_scan(self, message: ScanMessage) -> None:
        self._read_clock()
        if not self._localisation.has_map:
            source = "topic" if self._config.use_map_topic else "service"
            name = rospy.resolve_name("map" if self._config.use_map_topic else "static_map")
            raise NoMapError(f"waiting for a map from {source} {name}")
        stamp = message.header.stamp
        laser, odom = self._listener.place_of_scan(
            message.header, self._odom_frame, self._base_frame
        )
        if self._remembered is not None:
            self._go_on(self._remembered, odom, scan_from_message(message, laser))
        name = message.header.frame_id
        if self._localisation.due(odom, name):
            update = self._localisation.advance(odom, scan_from_message(message, laser), name)
            if update.estimate is not None:
                self._estimate, self._map_from_odom = update.estimate, update.map_from_odom
                self._publish_estimate(update.estimate, stamp)
                self._tell_if_lost()
            self._publish_cloud(stamp)
        self._dropping.end()
        self._broadcast(stamp)
        self._diagnose()
        if self._estimate is not None:
            self._store.save(self._estimate, self._now)
            self._keep(self._estimate, odom)

    def _tell_if_lost(self) -> None:
        lost, before = self._localisation.lost, self._lost
        if lost and not before:
            rospy.logwarn(
                "localisation is lost: the laser looks through walls of the map here, and %.0f %% of the scan fits; "
                "set the pose on initialpose, or call global_localization",
                100.0 * self._localisation.agreement,
            )
        elif before and not lost:
            rospy.loginfo(
                "localisation recovered: %.0f %% of the scan fits the map",
                100.0 * self._localisation.agreement,
            )
        self._lost = lost

    def _read_clock(self) -> None:
        """Reads the clock; when simulated time starts again, so does localisation."""
        jump = self._clock.read(rospy.get_time())
        if jump is Jump.NONE:
            return
        self._store.restart()
        self._next_cloud = self._next_diagnosis = 0.0
        if jump is Jump.RESET:
            rospy.logwarn("time jumped back: localisation starts again at the initial pose")
            self._remembered = None
            self._start_at_initial_pose()
            self._correction.forget()  # odometry has restarted, so the correction is invalid

    @property
    def _now(self) -> float:
        """ROS time of the newest scan's arrival [s]."""
        return self._clock.now

    # Commands, run by the loop.

    def _configure(self, config: AmclConfig) -> None:
        """Applies new parameters; keeps the particles."""
        before, self._config = self._config, config
        self._localisation.configure(config)
        if config.save_pose_rate != before.save_pose_rate:
            self._store = PoseStore(config.save_pose_rate)
        if config.use_map_topic != before.use_map_topic:
            if self._maps is not None:
                self._maps.unregister()
            self._maps = self._ask_for_map()
        frames = ("global_frame_id", "odom_frame_id", "base_frame_id")
        if any(getattr(config, name) != getattr(before, name) for name in frames):
            self._map_from_odom = None
            self._map_frame, self._odom_frame, self._base_frame = self._listen()

    def _start_at_initial_pose(self) -> None:
        self._start_at(self._initial_pose())
        self._estimate = self._map_from_odom = None

    def _start_at(self, pose: Pose) -> None:
        config = self._config
        covariance = np.diag([config.initial_cov_xx, config.initial_cov_yy, config.initial_cov_aa])
        self._localisation.set_pose(pose, covariance)

    def _read_correction(self) -> Correction | None:
        """Reads the correction file; an invalid file is only a warning, since a respawned amcl would fail forever."""
        try:
            return self._correction.read(self._odom_frame)
        except CorrectionFileError as error:
            rospy.logwarn("%s; starting at the initial pose", error)
            return None

    def _keep(self, estimate: Estimate, odom: Pose) -> None:
        """Writes the correction of each new estimate; a file that cannot be written costs a warning."""
        if estimate is self._kept or self._map_from_odom is None:
            return
        self._kept = estimate
        try:
            self._correction.write(Correction(self._map_from_odom, odom), self._odom_frame)
            self._unkept.end()
        except CorrectionFileError as error:
            self._unkept.warn(str(error))

    def _go_on(self, remembered: Correction, odom: Pose, scan: Scan) -> None:
        """Restarts once at the remembered pose, moved by the odometry since the previous amcl ended."""
        self._remembered = None
        pose = remembered.map_from_odom.compose(odom)
        if not has_continued(
            remembered,
            self._initial_pose(),
            odom,
            lambda place: self._localisation.agreement_at(place, scan),
        ):
            rospy.logwarn(
                "~correction_file is not used: odometry was restarted; starting at the initial pose"
            )
            self._start_at(self._initial_pose().compose(odom))
            return
        self._localisation.set_pose(pose, REMEMBERED_COVARIANCE)
        rospy.loginfo(
            "resuming at %.3f %.3f m, heading %.3f rad (from ~correction_file)",
            pose.x,
            pose.y,
            pose.yaw,
        )

    def _initial_pose(self) -> Pose:
        config = self._config
        return Pose(config.initial_pose_x, config.initial_pose_y, config.initial_pose_a)

    def _scatter(self) -> None:
        self._localisation.scatter()
        self._remembered = self._map_from_odom = None
        rospy.loginfo("particles spread over the whole map")

    def _fetch_map(self) -> None:
        """Asks for the map in a separate thread, and queues it for the loop."""
        message = fetch_map()
        if message is not None:
            self._post(functools.partial(self._set_map, message))

    def _set_map(self, message: GridMessage, again: bool = False) -> None:
        if self._config.first_map_only and self._localisation.has_map and not again:
            return
        if stripped(message.header.frame_id) != self._map_frame:
            rospy.logwarn(
                "the map is in frame '%s', not '%s'", message.header.frame_id, self._map_frame
            )
        grid = grid_from_message(message)
        self._localisation.set_map(grid)
        rospy.loginfo("map of %d x %d cells of %g m", grid.cols, grid.rows, grid.resolution)

    def _set_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        frame = stripped(message.header.frame_id)
        if frame not in ("", self._map_frame):
            rospy.logwarn(
                "initial pose ignored: it is in frame '%s', not '%s'", frame, self._map_frame
            )
            return
        pose = pose_from_message(message.pose.pose).compose(self._moved_since(message.header.stamp))
        self._localisation.set_pose(pose, covariance_from_message(message))
        self._remembered = self._map_from_odom = None
        if self._config.force_update_after_initialpose:
            self._localisation.force_update()
        rospy.loginfo("initial pose %.3f %.3f m, heading %.3f rad", pose.x, pose.y, pose.yaw)

    def _moved_since(self, stamp: rospy.Time) -> Pose:
        """Returns the robot's motion since ``stamp``, by which a pose with that stamp has to be moved."""
        if stamp.is_zero():
            return Pose()
        try:
            then = self._listener.lookup(self._odom_frame, self._base_frame, stamp.to_sec())
            now = self._listener.lookup(self._odom_frame, self._base_frame)
        except TransformError:
            return (
                Pose()
            )  # the stamp is newer than the odometry or too old: the pose counts as current
        return then.inverse().compose(now).planar()

    # Publishing.

    def _publish_estimate(self, estimate: Estimate, stamp: rospy.Time) -> None:
        body = PoseWithCovariance(
            message_from_pose(estimate.pose), covariance_message(estimate.covariance)
        )
        self._pose_publisher.publish(
            PoseWithCovarianceStamped(Header(0, stamp, self._map_frame), body)
        )

    def _publish_cloud(self, stamp: rospy.Time) -> None:
        if self._now < self._next_cloud:
            return
        rate = self._config.gui_publish_rate
        self._next_cloud = self._now + 1.0 / rate if rate > 0.0 else 0.0
        self._cloud_publisher.publish(
            ParticlesMessage(self._localisation.particles.copy(), self._map_frame, stamp)
        )

    def _diagnose(self) -> None:
        """Publishes the uncertainty of the newest estimate once per second."""
        if self._estimate is None or self._now < self._next_diagnosis:
            return
        self._next_diagnosis = self._now + DIAGNOSIS_PERIOD
        config = self._config
        limits = (config.std_warn_level_x, config.std_warn_level_y, config.std_warn_level_yaw)
        status = deviation_status(rospy.get_name().strip("/"), self._estimate.covariance, limits)
        self._diagnostics.publish(
            DiagnosticArray(Header(0, rospy.Time.from_sec(self._now), ""), [status])
        )

    def _broadcast(self, stamp: rospy.Time) -> None:
        """Sends the newest map_from_odom, stamped ahead so that listeners need not wait for the next one."""
        if self._map_from_odom is None or not self._config.tf_broadcast:
            return
        ahead = stamp + rospy.Duration.from_sec(self._config.transform_tolerance)
        self._broadcaster.send(self._map_frame, self._odom_frame, ahead, self._map_from_odom)


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("amcl", AmclNode, expected=(NavigationError,))
