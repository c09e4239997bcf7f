"""What each element of SDF 1.4 to 1.7 and of URDF does here, and notes about those that have no effect.

The table is the one place that knows which elements are named: readers take what they use and pass over the rest, and
`note_unused` goes once through a document. Tests hold the table against the readers.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from pioneer_gazebo.world.element import Element, Notes, library_of

USED = "used"
"""It has an effect."""
QUIET = "quiet"
"""It concerns looks, sound, Gazebo's window or its solver: robots neither sense nor feel it. It is not named."""
NAMED = "named"
"""It has an effect in Gazebo and none here: a warning names it."""

TABLE = """
world
  used    gravity model actor include population frame state physics
  quiet   light/*
  quiet   gui/* scene/* audio/* atmosphere/* magnetic_field spherical_coordinates/* wind/*
  named   road/* joint/* plugin

include
  used    uri name pose static
  named   plugin

frame
  used    pose

population
  used    pose model_count model include distribution distribution/type distribution/rows distribution/cols
  used    distribution/step box box/size cylinder cylinder/radius cylinder/length
  named   frame

physics
  used    gravity real_time_factor real_time_update_rate max_step_size
  quiet   magnetic_field max_contacts ode/* bullet/* simbody/* dart/*

state
  used    model model/pose model/link model/link/pose
  quiet   sim_time real_time wall_time iterations light/* model/joint/*
  quiet   model/frame model/link/frame model/link/velocity model/link/acceleration model/link/wrench
  quiet   model/link/collision/*
  named   model/scale = 1 1 1
  named   model/model/* insertions/* deletions/*

model
  used    pose static link joint model include frame plugin
  quiet   allow_auto_disable
  named   gripper/*
  named   self_collide = 0
  named   enable_wind = 0
  named   scale = 1 1 1

actor
  used    pose link skin skin/scale script script/loop script/delay_start script/auto_start script/trajectory
  used    script/trajectory/waypoint script/trajectory/waypoint/time script/trajectory/waypoint/pose
  quiet   skin/filename animation/* static frame
  named   joint/* plugin
  named   self_collide = 0
  named   enable_wind = 0

link
  used    pose gravity kinematic inertial collision visual sensor
  quiet   light/* audio_sink audio_source/* projector/* particle_emitter/* must_be_base_link allow_auto_disable
  named   battery/* frame
  named   self_collide = 0
  named   enable_wind = 0
  named   velocity_decay/linear = 0
  named   velocity_decay/angular = 0
  named   velocity = 0 0 0 0 0 0
  named   acceleration = 0 0 0 0 0 0
  named   wrench = 0 0 0 0 0 0

inertial
  used    pose mass inertia inertia/ixx inertia/iyy inertia/izz inertia/ixy inertia/ixz inertia/iyz
  named   frame

collision
  used    pose geometry surface surface/friction surface/friction/ode surface/friction/ode/mu
  used    surface/bounce surface/bounce/restitution_coefficient
  quiet   max_contacts surface/contact surface/contact/ode/* surface/contact/bullet/* surface/friction/bullet/*
  quiet   surface/contact/poissons_ratio surface/contact/elastic_modulus surface/soft_contact/* surface/bounce/threshold
  quiet   surface/contact/category_bitmask surface/friction/torsional surface/friction/torsional/ode
  quiet   surface/friction/torsional/patch_radius surface/friction/torsional/surface_radius
  quiet   surface/friction/torsional/use_patch_radius surface/contact/collide_without_contact_bitmask
  named   frame
  named   laser_retro = 0
  named   surface/friction/ode/mu2 = mu
  named   surface/friction/ode/fdir1 = 0 0 0
  named   surface/friction/ode/slip1 = 0
  named   surface/friction/ode/slip2 = 0
  named   surface/friction/torsional/coefficient = 1
  named   surface/friction/torsional/ode/slip = 0
  named   surface/contact/collide_without_contact = 0
  named   surface/contact/collide_bitmask = 65535 | 0xffff

geometry
  used    empty box box/size cylinder cylinder/radius cylinder/length sphere sphere/radius plane plane/normal plane/size
  used    mesh mesh/uri mesh/scale polyline polyline/point polyline/height
  named   mesh/submesh/* heightmap/* image/*

visual
  used    pose geometry material
  quiet   cast_shadows laser_retro meta/* visibility_flags
  named   plugin frame
  named   transparency = 0

material
  used    diffuse ambient script script/name
  quiet   script/uri specular emissive lighting shader/* pbr/* double_sided render_order

joint
  used    parent child pose axis axis/xyz axis/use_parent_model_frame axis/limit axis/limit/lower axis/limit/upper
  used    axis/limit/effort axis/limit/velocity axis/dynamics axis/dynamics/damping axis/dynamics/friction
  quiet   axis/limit/stiffness axis/limit/dissipation axis/dynamics/spring_reference physics/* axis2/*
  quiet   gearbox_ratio gearbox_reference_body thread_pitch
  named   sensor/* frame
  named   axis/initial_position = 0
  named   axis/dynamics/spring_stiffness = 0

sensor
  used    pose update_rate plugin ray ray/scan ray/scan/horizontal ray/scan/horizontal/samples
  used    ray/scan/horizontal/min_angle ray/scan/horizontal/max_angle ray/range ray/range/min ray/range/max
  used    ray/noise ray/noise/mean ray/noise/stddev
  used    camera camera/horizontal_fov camera/pose camera/image camera/image/width camera/image/height
  used    camera/image/format camera/clip camera/clip/near camera/clip/far camera/noise camera/noise/stddev
  used    contact contact/collision
  quiet   always_on visualize topic enable_metrics ray/range/resolution ray/noise/type ray/scan/vertical
  quiet   ray/scan/horizontal/resolution ray/scan/vertical/resolution ray/scan/vertical/min_angle
  quiet   ray/scan/vertical/max_angle camera/noise/type camera/visibility_mask camera/frame camera/depth_camera
  quiet   camera/depth_camera/output camera/distortion camera/distortion/center contact/topic imu imu/topic
  quiet   gps/* altimeter/* magnetometer/* air_pressure/* force_torque/* sonar/* rfid rfidtag logical_camera/*
  quiet   transceiver/* lidar/*
  named   frame camera/save/* camera/lens/* camera/depth_camera/clip/*
  named   imu/noise/* imu/angular_velocity/* imu/linear_acceleration/* imu/orientation_reference_frame/*
  named   imu/enable_orientation = 1
  named   ray/scan/vertical/samples = 1
  named   camera/noise/mean = 0
  named   camera/distortion/k1 = 0
  named   camera/distortion/k2 = 0
  named   camera/distortion/k3 = 0
  named   camera/distortion/p1 = 0
  named   camera/distortion/p2 = 0

robot
  used    link joint gazebo material material/color
  quiet   material/texture transmission/* sensor/* verbose

urdf link
  used    inertial inertial/origin inertial/mass inertial/inertia visual visual/origin visual/geometry/* visual/material
  used    visual/material/color collision collision/origin collision/geometry/*
  quiet   visual/material/texture collision/verbose collision/material/* contact/* contact_coefficients

urdf joint
  used    origin parent child axis limit dynamics mimic
  quiet   calibration safety_controller hardwareInterface

gazebo
  used    static plugin
  quiet   pose allow_auto_disable
  named   self_collide = 0
  named   enable_wind = 0

gazebo reference
  used    mu1 mu material sensor turnGravityOff gravity kinematic
  quiet   kp kd minDepth maxVel maxContacts max_contacts implicitSpringDamper provideFeedback stopCfm stopErp
  quiet   fudgeFactor disableFixedJointLumping preserveFixedJoint visual/* cfmDamping cfm_damping
  named   plugin collision/* static
  named   mu2 = mu
  named   fdir1 = 0 0 0
  named   selfCollide = 0
  named   self_collide = 0
  named   laserRetro = 0
  named   dampingFactor = 0
  named   springStiffness = 0
  named   springReference = 0
  named   velocity_decay/linear = 0
  named   velocity_decay/angular = 0
"""
"""A line has a status and paths below the owner, or a path and the values with which it does nothing in Gazebo either.

``path/*`` is the element and all that is below it. ``mu`` is the value of the element beside it.
"""

SENSORS = ("ray", "gpu_ray", "camera", "depth", "contact", "imu")
"""Types of sensors that are read; others are named as a whole by their reader."""

BUILT_IN = (
    "gazebo_ros_api_plugin",
    "gazebo_ros_paths_plugin",
    "gazebo_ros_init",
    "gazebo_ros_factory",
)
"""Plugins of a world whose services the simulator has without them."""

_ZERO = ("0", "false")
_ONE = ("1", "true")


@dataclass(frozen=True, slots=True)
class Rule:
    """What the elements at one path do."""

    status: str  #: `USED`, `QUIET` or `NAMED`
    is_branch: bool = False  #: whether all that is below it has the same status
    idle: tuple[str, ...] = ()  #: values with which a named element does nothing in Gazebo either


def rules() -> dict[str, dict[str, Rule]]:
    """Returns for each owner, such as ``link``, the rule of each path below it."""
    table: dict[str, dict[str, Rule]] = {}
    owner = ""
    for line in TABLE.strip().splitlines():
        if line and not line.startswith(" "):
            owner = line
            table[owner] = {}
        elif line:
            status, _, rest = line.strip().partition(" ")
            paths, _, values = rest.partition(" = ")
            idle = tuple(value.strip() for value in values.split("|")) if values else ()
            for path in paths.split():
                bare = path.removesuffix("/*")
                table[owner][bare] = Rule(status, bare != path, idle)
    return table


_RULES = rules()
_SDF_OWNERS = _RULES.keys() - {"robot", "urdf link", "urdf joint", "gazebo", "gazebo reference"}
_URDF_OWNERS = {"link": "urdf link", "joint": "urdf joint"}


def note_unused(root: Element, notes: Notes) -> None:
    """Adds a note for each kind of element in a document that has no effect.

    Args:
        root: ``<sdf>`` or ``<robot>``.
        notes: receives for each kind the place of the first one and how many there are.
    """
    if root.tag == "robot":
        _visit(root, "robot", "", notes)
    for child in root.children():
        if root.tag == "sdf" and child.tag in _SDF_OWNERS:
            _visit(child, child.tag, "", notes)


def _visit(element: Element, owner: str, path: str, notes: Notes) -> None:
    for child in element.children():
        below = f"{path}/{child.tag}" if path else child.tag
        rule = _rule(owner, below)
        if rule is None:
            notes.count(child, f"<{below}> in <{_spelt(owner)}> is unknown and ignored")
        elif rule.status == NAMED:
            if not _is_idle(rule, child, element):
                notes.count(child, f"<{below}>{_library(child)} in <{_spelt(owner)}> has no effect")
        elif not rule.is_branch:
            inner = _owner_of(child, owner)
            if inner is not None:
                _visit(child, inner, "", notes)
            elif child.tag not in ("plugin", "sensor"):
                _visit(child, owner, below, notes)


def _owner_of(child: Element, owner: str) -> str | None:
    """Returns the owner of the elements in a child; None if they belong to its own owner, or are read elsewhere."""
    if child.tag == "sensor":
        is_read = child.attribute("type", "") in SENSORS and child.child("plugin") is not None
        return "sensor" if is_read else None
    if owner == "robot" and child.tag == "gazebo":
        return "gazebo reference" if child.attribute("reference", "") else "gazebo"
    if owner == "robot":
        return _URDF_OWNERS.get(child.tag)
    is_own = owner in ("state", "urdf link", "urdf joint", "gazebo", "gazebo reference")
    return child.tag if child.tag in _SDF_OWNERS and not is_own else None


def _rule(owner: str, path: str) -> Rule | None:
    table = _RULES[owner]
    if path in table:
        return table[path]
    # An element that only groups others has no rule of its own.
    if any(known.startswith(f"{path}/") for known in table):
        return Rule(QUIET)
    return None


def _is_idle(rule: Rule, element: Element, parent: Element) -> bool:
    """Returns whether a named element does nothing in Gazebo either."""
    if element.tag == "plugin":
        return library_of(element) in BUILT_IN
    if rule.is_branch:
        is_named_only = next(element.children(), None) is None and element.attribute("name", "")
        return not is_named_only and not any(_is_active(leaf) for leaf in _leaves(element))
    text = element.attribute("value", element.text)
    if rule.idle == ("mu",):
        first = parent.child("mu") or parent.child("mu1")
        return first is not None and _same(text, first.attribute("value", first.text))
    return not text or any(_same(text, value) for value in rule.idle)


def _leaves(element: Element) -> Iterator[Element]:
    children = list(element.children())
    if not children:
        yield element
    for child in children:
        yield from _leaves(child)


def _is_active(leaf: Element) -> bool:
    return leaf.text.lower() not in ("", "none", "default", "__default__") and not _same(
        leaf.text, "0"
    )


def _same(text: str, value: str) -> bool:
    """Returns whether two values are the same numbers, booleans or words."""
    try:
        return [float(word) for word in text.split()] == [float(word) for word in value.split()]
    except ValueError:
        pass
    word = text.strip().lower()
    return word == value or any(word in both and value in both for both in (_ZERO, _ONE))


def _library(element: Element) -> str:
    return f" lib{library_of(element)}.so" if element.tag == "plugin" else ""


def _spelt(owner: str) -> str:
    return owner.removeprefix("urdf ")
