"""The table of elements says what readers do: used ones change what is read, quiet and named ones nothing.

Every path in the table is tried. A used one needs a pair of values below, so that the table cannot promise what no
reader does.
"""

import dataclasses

import pytest

from pioneer_gazebo.world.element_page import page
from pioneer_gazebo.world.element_table import NAMED, QUIET, USED, rules
from pioneer_gazebo.world.sdf import world_from_sdf_text
from pioneer_gazebo.world.urdf import robot_from_urdf

# Documents: each has a value of every used element below one owner.

SHAPE = "<geometry><box><size>1 2 3</size></box></geometry>"
MOMENTS = "".join(
    f"<i{a}>{v}</i{a}>" for a, v in zip(("xx", "yy", "zz", "xy", "xz", "yz"), "111000", strict=True)
)
RAY = """<pose>0 0 1 0 0 0</pose><update_rate>5</update_rate><ray><scan><horizontal><samples>9</samples>
<min_angle>-1</min_angle><max_angle>1</max_angle></horizontal></scan><range><min>0.1</min><max>9</max></range>
<noise><type>gaussian</type><mean>0</mean><stddev>0.01</stddev></noise>{}</ray>{}
<plugin name='p' filename='libgazebo_ros_laser.so'/>"""
LASER = f"<sensor name='s' type='ray'>{RAY}</sensor>"
CAMERA = """<sensor name='s' type='camera'><camera><horizontal_fov>1</horizontal_fov><pose>0 0 0 0 0 0</pose><image>
<width>8</width><height>6</height><format>R8G8B8</format></image><clip><near>0.1</near><far>9</far></clip>
<noise><type>gaussian</type><stddev>0.01</stddev></noise>{}</camera>
<plugin name='p' filename='libgazebo_ros_camera.so'/></sensor>"""
BUMPER = """<sensor name='s' type='contact'><contact><collision>c</collision>{}</contact>
<plugin name='p' filename='libgazebo_ros_bumper.so'/></sensor>"""
IMU = "<sensor name='s' type='imu'><imu>{}</imu><plugin name='p' filename='libgazebo_ros_imu_sensor.so'/></sensor>"
LINK = f"""<link name='l'><pose>1 0 0 0 0 0</pose><gravity>1</gravity><kinematic>0</kinematic>
<inertial><pose>0 0 1 0 0 0</pose><mass>2</mass><inertia>{MOMENTS}</inertia>{{inertial}}</inertial>
<collision name='c'><pose>0 0 2 0 0 0</pose>{SHAPE}<surface><friction><ode><mu>0.5</mu></ode></friction><bounce>
<restitution_coefficient>0.5</restitution_coefficient></bounce></surface>{{collision}}</collision>
<visual name='v'><pose>0 0 3 0 0 0</pose>{SHAPE}<material><ambient>1 0 0 1</ambient>{{material}}</material>{{visual}}
</visual>{{link}}</link>"""
PARTS = ("inertial", "collision", "material", "visual", "link")


def in_link(**inserted: str) -> str:
    link = LINK.format(**{part: inserted.get(part, "") for part in PARTS})
    return f"<model name='m'><pose>0 1 0 0 0 0</pose><static>0</static>{link}</model>"


JOINTED = """<model name='m'><link name='a'/><link name='b'/><link name='c'/><frame name='f'><pose>1 0 0 0 0 0</pose>
</frame><joint name='j' type='revolute'><pose relative_to='f'>0 0 0 1 0 0</pose><parent>a</parent><child>b</child><axis>
<xyz>0 0 1</xyz><use_parent_model_frame>0</use_parent_model_frame><limit><lower>-1</lower><upper>1</upper>
<effort>5</effort><velocity>6</velocity></limit><dynamics><damping>0.1</damping><friction>0.2</friction></dynamics>
{axis}</axis>{joint}</joint>{model}</model>"""


def jointed(axis: str = "", joint: str = "", model: str = "") -> str:
    return JOINTED.replace("{{", "{").replace("}}", "}").format(axis=axis, joint=joint, model=model)


CRATE = f"<model name='crate'><link name='l'><collision name='c'>{SHAPE}</collision></link></model>"
ACTOR = """<actor name='a'><pose>1 0 0 0 0 0</pose><skin><scale>1</scale></skin><script><loop>1</loop>
<delay_start>0</delay_start><auto_start>1</auto_start><trajectory id='0' type='walk'><waypoint><time>1</time>
<pose>2 0 0 0 0 0</pose></waypoint></trajectory></script>{}</actor>"""
CROWD = f"""<population name='p'><pose>0 0 1 0 0 0</pose>{CRATE}<model_count>3</model_count><distribution>
<type>{{}}</type><rows>2</rows><cols>2</cols><step>1 1 0</step></distribution>{{}}</population>"""
BOX, DRUM = (
    "<box><size>4 4 1</size></box>",
    "<cylinder><radius>1</radius><length>2</length></cylinder>",
)
PHYSICS = """<physics><max_step_size>0.001</max_step_size><real_time_update_rate>0</real_time_update_rate>
<real_time_factor>2</real_time_factor><gravity>0 0 -2</gravity>{}</physics>"""
STATE = (
    CRATE
    + """<state><model name='crate'><pose>1 0 0 0 0 0</pose><link name='l'><pose>2 0 0 0 0 0</pose></link>
</model>{}</state>"""
)
INCLUDE = "<include><uri>model://ground_plane</uri><name>n</name><pose>1 0 0 0 0 0</pose><static>1</static>{}</include>"
GEOMETRY = """<model name='m'><static>1</static><link name='l'><collision name='c'><geometry>{}</geometry></collision>
</link></model>"""
ROD = "<cylinder><radius>1</radius><length>2</length></cylinder>"
PLANE = "<plane><normal>0 0 1</normal><size>5 5</size></plane>"
MESH = "<mesh><uri>hall.obj</uri><scale>1 1 1</scale></mesh>"
AREA = (
    "<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>1</height></polyline>"
)
URDF = (
    """<robot name='r'><material name='red'><color rgba='1 0 0 1'/></material><link name='a'><inertial>
<origin xyz='0 0 1'/><mass value='2'/><inertia ixx='1' iyy='1' izz='1'/></inertial><visual><origin xyz='0 0 2'/>
<geometry><box size='1 2 3'/></geometry><material name='red'/></visual><collision><origin xyz='0 0 3'/><geometry>
<box size='1 2 4'/></geometry></collision>{link}</link><link name='b'/><link name='c'/><joint name='j' type='revolute'>
<origin xyz='0 0 4'/><parent link='a'/><child link='b'/><axis xyz='0 0 1'/><limit lower='-1' upper='1'/>
<dynamics damping='0.1'/>{joint}</joint><joint name='k' type='revolute'><parent link='a'/><child link='c'/>
<mimic joint='j' multiplier='2'/><limit lower='-1' upper='1'/></joint><gazebo><static>0</static>
<plugin name='p' filename='libgazebo_ros_planar_move.so'/>{gazebo}</gazebo><gazebo reference='a'><mu1>0.5</mu1>
<material>Gazebo/Red</material><turnGravityOff>0</turnGravityOff><kinematic>0</kinematic>{reference}</gazebo>
<gazebo reference='b'><mu>0.4</mu><gravity>1</gravity><sensor name='s' type='ray'>"""
    + RAY.format("", "")
    + """</sensor>
</gazebo>{robot}</robot>"""
)


def urdf(**inserted: str) -> str:
    parts = ("link", "joint", "gazebo", "reference", "robot")
    return URDF.format(**{part: inserted.get(part, "") for part in parts})


PAIRS: dict[str, list[tuple[str, str, str]]] = {
    "world/gravity": [("<gravity>0 0 -1</gravity>", "-1", "-2")],
    "world/model": [(CRATE, "crate", "box")],
    "world/actor": [(ACTOR, "name='a'", "name='b'")],
    "world/include": [(INCLUDE, "<name>n", "<name>o")],
    "world/population": [(CROWD.format("random", BOX), "crate", "box")],
    "world/frame": [(f"<frame name='f'><pose>1 0 0 0 0 0</pose></frame>{CRATE}", "<link name='l'>",
                     "<pose relative_to='f'/><link name='l'>")],
    "world/state": [(STATE, "<state><model name='crate'>", "<state><model name='box'>")],
    "world/physics": [(PHYSICS, "<physics>", "<physics><gravity>0 0 -9</gravity>")],
    "include/uri": [(INCLUDE, "ground_plane", "nothing")],
    "include/name": [(INCLUDE, "<name>n", "<name>o")],
    "include/pose": [(INCLUDE, "1 0 0", "2 0 0")],
    "include/static": [(INCLUDE, "<static>1", "<static>0")],
    "frame/pose": [(jointed(), "1 0 0 0 0 0", "2 0 0 0 0 0")],
    "population/pose": [(CROWD.format("random", BOX), "0 0 1 0 0 0", "0 0 2 0 0 0")],
    "population/model_count": [(CROWD.format("random", BOX), "count>3", "count>4")],
    "population/model": [(CROWD.format("random", BOX), "crate", "box")],
    "population/include": [(CROWD.replace(CRATE, INCLUDE).format("", "random", BOX), "<name>n", "<name>o")],
    "population/distribution/type": [(CROWD.format("linear-x", BOX), "linear-x", "linear-y"),
                                     (CROWD.format("random", BOX), "random", "uniform"),
                                     (CROWD.format("uniform", BOX), "uniform", "linear-z")],
    "population/distribution/rows": [(CROWD.format("grid", BOX), "<rows>2", "<rows>3")],
    "population/distribution/cols": [(CROWD.format("grid", BOX), "<cols>2", "<cols>3")],
    "population/distribution/step": [(CROWD.format("grid", BOX), "1 1 0", "2 1 0")],
    "population/box": [(CROWD.format("random", BOX), BOX, DRUM)],
    "population/box/size": [(CROWD.format("random", BOX), "4 4 1", "5 4 1")],
    "population/cylinder": [(CROWD.format("random", DRUM), DRUM, BOX)],
    "population/cylinder/radius": [(CROWD.format("random", DRUM), "<radius>1", "<radius>2")],
    "population/cylinder/length": [(CROWD.format("random", DRUM), "<length>2", "<length>3")],
    "physics/gravity": [(PHYSICS, "-2", "-3")],
    "physics/real_time_factor": [(PHYSICS, "factor>2", "factor>3")],
    "physics/real_time_update_rate": [(PHYSICS, "rate>0", "rate>500")],
    "physics/max_step_size": [(PHYSICS.replace("rate>0", "rate>500"), "size>0.001", "size>0.002")],
    "state/model": [(STATE, "<state><model name='crate'>", "<state><model name='box'>")],
    "state/model/pose": [(STATE, "1 0 0", "3 0 0")],
    "state/model/link": [(STATE, "<link name='l'><pose>2", "<link name='k'><pose>2")],
    "state/model/link/pose": [(STATE, "2 0 0", "3 0 0")],
    "model/pose": [(in_link(), "0 1 0 0 0 0", "0 2 0 0 0 0")],
    "model/static": [(in_link(), "<static>0", "<static>1")],
    "model/link": [(in_link(), "<link name='l'>", "<link name='k'>")],
    "model/joint": [(jointed(), "joint name='j'", "joint name='i'")],
    "model/model": [(jointed(model=CRATE), "crate", "box")],
    "model/include": [(jointed(model=INCLUDE), "<name>n", "<name>o")],
    "model/frame": [(jointed(), "frame name='f'", "frame name='g'")],
    "model/plugin": [(jointed(model="<plugin name='p' filename='libgazebo_ros_planar_move.so'/>"), "'p'", "'q'")],
    "actor/pose": [(ACTOR, "<pose>1", "<pose>3")],
    "actor/link": [(ACTOR.format(f"<link name='l'><collision name='c'>{SHAPE}</collision></link>"), "'l'", "'k'")],
    "actor/skin/scale": [(ACTOR, "<scale>1", "<scale>2")],
    "actor/script/loop": [(ACTOR, "<loop>1", "<loop>0")],
    "actor/script/delay_start": [(ACTOR, "start>0", "start>1")],
    "actor/script/auto_start": [(ACTOR, "auto_start>1", "auto_start>0")],
    "actor/script/trajectory": [(ACTOR, "</trajectory>", "</trajectory><trajectory><waypoint><time>1</time>"
                                 "<pose>9 0 0 0 0 0</pose></waypoint></trajectory>")],
    "actor/script/trajectory/waypoint/time": [(ACTOR, "<time>1", "<time>2")],
    "actor/script/trajectory/waypoint/pose": [(ACTOR, "<pose>2", "<pose>3")],
    "link/pose": [(in_link(), "1 0 0 0 0 0", "2 0 0 0 0 0")],
    "link/gravity": [(in_link(), "<gravity>1", "<gravity>0")],
    "link/kinematic": [(in_link(), "<kinematic>0", "<kinematic>1")],
    "link/inertial": [(in_link(), "<mass>2", "<mass>3")],
    "link/collision": [(in_link(), "collision name='c'", "collision name='d'")],
    "link/visual": [(in_link(), "visual name='v'", "visual name='w'")],
    "link/sensor": [(in_link(link=LASER.format("", "")), "sensor name='s'", "sensor name='t'")],
    "inertial/pose": [(in_link(), "0 0 1 0 0 0", "0 0 2 0 0 0")],
    "inertial/mass": [(in_link(), "<mass>2", "<mass>3")],
    **{f"inertial/inertia/{tag}": [(in_link(), f"<{tag}>{old}", f"<{tag}>0.5")]
       for tag, old in zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "111000", strict=True)},
    "collision/pose": [(in_link(), "0 0 2 0 0 0", "0 0 4 0 0 0")],
    "collision/geometry": [(in_link(), SHAPE, SHAPE.replace("1 2 3", "4 5 6"))],
    "collision/surface/friction/ode/mu": [(in_link(), "<mu>0.5", "<mu>0.6")],
    "collision/surface/bounce/restitution_coefficient": [(in_link(), "coefficient>0.5", "coefficient>0.6")],
    "geometry/empty": [(GEOMETRY.format("<empty/>"), "<empty/>", ROD)],
    "geometry/box": [(GEOMETRY.format("<box><size>1 1 1</size></box>"), "<box><size>1 1 1</size></box>", ROD)],
    "geometry/box/size": [(GEOMETRY.format("<box><size>1 1 1</size></box>"), "1 1 1", "2 1 1")],
    "geometry/cylinder/radius": [(GEOMETRY.format(ROD), "<radius>1", "<radius>3")],
    "geometry/cylinder/length": [(GEOMETRY.format(ROD), "<length>2", "<length>3")],
    "geometry/sphere/radius": [(GEOMETRY.format("<sphere><radius>1</radius></sphere>"), "1</r", "2</r")],
    "geometry/plane/normal": [(GEOMETRY.format(PLANE), "0 0 1", "0 1 0")],
    "geometry/plane/size": [(GEOMETRY.format(PLANE), "5 5", "6 6")],
    "geometry/mesh/uri": [(GEOMETRY.format(MESH), "hall.obj", "gate.dae")],
    "geometry/mesh/scale": [(GEOMETRY.format(MESH), "1 1 1", "2 2 2")],
    "geometry/polyline/point": [(GEOMETRY.format(AREA), "1 0", "2 0")],
    "geometry/polyline/height": [(GEOMETRY.format(AREA), "<height>1", "<height>2")],
    "visual/pose": [(in_link(), "0 0 3 0 0 0", "0 0 4 0 0 0")],
    "visual/geometry": [(in_link(), SHAPE, SHAPE.replace("1 2 3", "4 5 6"))],
    "visual/material": [(in_link(), "<ambient>1 0 0 1</ambient>", "")],
    "material/ambient": [(in_link(), "<ambient>1", "<ambient>0")],
    "material/diffuse": [(in_link(material="<diffuse>0 0 1 1</diffuse>"), "<diffuse>0", "<diffuse>1")],
    "material/script/name": [
        (in_link(material="<script><name>Gazebo/Red</name></script>").replace("<ambient>1 0 0 1</ambient>", ""),
         "Gazebo/Red", "Gazebo/Blue")],
    "joint/parent": [(jointed(), "<parent>a", "<parent>c")],
    "joint/child": [(jointed(), "<child>b", "<child>c")],
    "joint/pose": [(jointed(), "0 0 0 1 0 0", "0 0 0 2 0 0")],
    "joint/axis": [(jointed(), "<xyz>0 0 1", "<xyz>1 0 0")],
    "joint/axis/xyz": [(jointed(), "<xyz>0 0 1", "<xyz>1 0 0")],
    "joint/axis/use_parent_model_frame": [(jointed(), "frame>0", "frame>1")],
    "joint/axis/limit/lower": [(jointed(), "<lower>-1", "<lower>-2")],
    "joint/axis/limit/upper": [(jointed(), "<upper>1", "<upper>2")],
    "joint/axis/limit/effort": [(jointed(), "<effort>5", "<effort>-1")],
    "joint/axis/limit/velocity": [(jointed(), "<velocity>6", "<velocity>7")],
    "joint/axis/dynamics/damping": [(jointed(), "<damping>0.1", "<damping>0.2")],
    "joint/axis/dynamics/friction": [(jointed(), "<friction>0.2", "<friction>0.3")],
    **{f"sensor/{path}": [(in_link(link=LASER.format("", "")), old, new)] for path, old, new in (
        ("pose", "<pose>0 0 1 0 0 0</pose><update", "<pose>0 0 2 0 0 0</pose><update"),
        ("update_rate", "rate>5", "rate>6"),
        ("plugin", "libgazebo_ros_laser", "libgazebo_ros_range"),
        ("ray/scan/horizontal/samples", "<samples>9", "<samples>8"),
        ("ray/scan/horizontal/min_angle", "<min_angle>-1", "<min_angle>-2"),
        ("ray/scan/horizontal/max_angle", "<max_angle>1", "<max_angle>2"),
        ("ray/range/min", "<min>0.1", "<min>0.2"),
        ("ray/range/max", "<max>9", "<max>8"),
        ("ray/noise/mean", "<mean>0", "<mean>1"),
        ("ray/noise/stddev", "<stddev>0.01", "<stddev>0.02"))},
    **{f"sensor/camera/{path}": [(in_link(link=CAMERA), old, new)] for path, old, new in (
        ("horizontal_fov", "fov>1", "fov>2"),
        ("pose", "<pose>0 0 0 0 0 0", "<pose>1 0 0 0 0 0"),
        ("image/width", "<width>8", "<width>9"),
        ("image/height", "<height>6", "<height>7"),
        ("image/format", "R8G8B8", "L8"),
        ("clip/near", "<near>0.1", "<near>0.2"),
        ("clip/far", "<far>9", "<far>8"),
        ("noise/stddev", "<stddev>0.01", "<stddev>0.02"))},
    "sensor/contact/collision": [(in_link(link=BUMPER), "<contact><collision>c", "<contact><collision>d")],
    "robot/link": [(urdf(), "'c'", "'d'")],
    "robot/joint": [(urdf(), "joint name='k'", "joint name='i'")],
    "robot/gazebo": [(urdf(), "plugin name='p'", "plugin name='q'")],
    "robot/material": [(urdf(reference="<material>none</material>"), "rgba='1", "rgba='0")],
    "robot/material/color": [(urdf(reference="<material>none</material>"), "rgba='1", "rgba='0")],
    "urdf link/inertial/origin": [(urdf(), "0 0 1'/><mass", "0 0 2'/><mass")],
    "urdf link/inertial/mass": [(urdf(), "mass value='2'", "mass value='3'")],
    "urdf link/inertial/inertia": [(urdf(), "ixx='1'", "ixx='0.5'")],
    "urdf link/visual/origin": [(urdf(), "0 0 2", "0 0 5")],
    "urdf link/visual/geometry": [(urdf(), "1 2 3", "3 2 1")],
    "urdf link/visual/material": [(urdf(reference="<material>none</material>"), "<material name='red'/>", "")],
    "urdf link/visual/material/color": [
        (urdf(reference="<material>none</material>").replace(
            "<material name='red'/>", "<material name='m'><color rgba='0 0 1 1'/></material>"),
         "0 0 1 1", "0 1 1 1")],
    "urdf link/collision/origin": [(urdf(), "0 0 3", "0 0 5")],
    "urdf link/collision/geometry": [(urdf(), "1 2 4", "4 2 1")],
    "urdf joint/origin": [(urdf(), "0 0 4", "0 0 5")],
    "urdf joint/parent": [(urdf(), "<parent link='a'/><child link='c'", "<parent link='b'/><child link='c'")],
    "urdf joint/child": [(urdf(), "'c'", "'d'")],
    "urdf joint/axis": [(urdf(), "axis xyz='0 0 1'", "axis xyz='0 1 0'")],
    "urdf joint/limit": [(urdf(), "lower='-1' upper='1'/>\n<dyn", "lower='-2' upper='1'/>\n<dyn")],
    "urdf joint/dynamics": [(urdf(), "damping='0.1'", "damping='0.2'")],
    "urdf joint/mimic": [(urdf(), "multiplier='2'", "multiplier='3'")],
    "gazebo/static": [(urdf(), "<static>0", "<static>1")],
    "gazebo/plugin": [(urdf(), "plugin name='p'", "plugin name='q'")],
    "gazebo reference/mu1": [(urdf(), "<mu1>0.5", "<mu1>0.6")],
    "gazebo reference/mu": [(urdf().replace("<link name='b'/>", "<link name='b'><collision><geometry>"
                             "<box size='1 1 1'/></geometry></collision></link>"), "<mu>0.4", "<mu>0.6")],
    "gazebo reference/material": [(urdf(), "Gazebo/Red", "Gazebo/Blue")],
    "gazebo reference/sensor": [(urdf(), "sensor name='s'", "sensor name='t'")],
    "gazebo reference/turnGravityOff": [(urdf(), "Off>0", "Off>1")],
    "gazebo reference/gravity": [(urdf(), "<gravity>1", "<gravity>0")],
    "gazebo reference/kinematic": [(urdf(), "<kinematic>0", "<kinematic>1")],
}  # fmt: skip
"""For each used element a document with it, a piece of it, and what replaces that piece."""

CONTEXTS = {
    "world": "{}",
    "include": INCLUDE,
    "frame": f"<frame name='f'>{{}}</frame>{CRATE}",
    "population": CROWD.format("random", BOX + "{}"),
    "physics": PHYSICS,
    "state": STATE,
    "model": jointed(model="{}"),
    "actor": ACTOR,
    "link": in_link(link="{}"),
    "inertial": in_link(inertial="{}"),
    "collision": in_link(collision="{}"),
    "geometry": in_link(link="<collision name='d'><geometry>{}</geometry></collision>"),
    "geometry/mesh": in_link(
        link=f"<collision name='d'><geometry>{MESH}</geometry></collision>"
    ).replace("</mesh>", "{}</mesh>"),
    "visual": in_link(visual="{}"),
    "material": in_link(material="{}"),
    "joint": jointed(joint="{}"),
    "joint/axis": jointed(axis="{}"),
    "sensor": in_link(link=LASER.format("", "{}")),
    "sensor/ray": in_link(link=LASER.format("{}", "")),
    "sensor/camera": in_link(link=CAMERA),
    "sensor/contact": in_link(link=BUMPER),
    "sensor/imu": in_link(link=IMU),
    "robot": urdf(robot="{}"),
    "urdf link": urdf(link="{}"),
    "urdf link/visual": urdf().replace("</visual>", "{}</visual>"),
    "urdf link/collision": urdf().replace("</collision>", "{}</collision>"),
    "urdf joint": urdf(joint="{}"),
    "gazebo": urdf(gazebo="{}"),
    "gazebo reference": urdf(reference="{}"),
}
"""Documents with a place for more elements below an owner, or below one of its elements."""

PATHS = [(owner, path, rule) for owner, table in rules().items() for path, rule in table.items()]


@pytest.fixture(autouse=True)
def _beside_the_worlds(monkeypatch, request):
    monkeypatch.chdir(request.path.parent.parent / "world")


def read(text):
    """Returns what is read of a document, and its notes."""
    if text.startswith("<robot"):
        found = robot_from_urdf(text)
    else:
        sdf = f"<sdf version='1.7'><world name='w'>{text}</world></sdf>"
        found = world_from_sdf_text(sdf, tolerant=True)
    return dataclasses.replace(found, warnings=()), found.warnings


def is_group(owner, path):
    return any(other.startswith(f"{path}/") for other in rules()[owner])


def with_element(owner, path, text):
    """Returns a document without and with an element that has a text, below an owner."""
    place = max(
        (key for key in CONTEXTS if f"{owner}/{path}".startswith(f"{key}/")),
        key=len,
    )
    tags = f"{owner}/{path}".removeprefix(f"{place}/").split("/")
    opened = "".join(f"<{tag} name='x' filename='libx.so'>" for tag in tags)
    closed = "".join(f"</{tag}>" for tag in reversed(tags))
    document = CONTEXTS[place]
    return document.replace("{}", ""), document.replace("{}", f"{opened}{text}{closed}")


@pytest.mark.parametrize(
    ("owner", "path"),
    [(o, p) for o, p, rule in PATHS if rule.status == USED and not is_group(o, p)],
)
def test_a_used_element_changes_what_is_read(owner, path):
    for document, old, new in PAIRS[f"{owner}/{path}"]:
        document = document.replace("{}", "")
        assert old in document
        before, notes = read(document)
        after, _ = read(document.replace(old, new))
        assert before != after
        tag = path.split("/")[-1]
        assert f"<{tag}" in document
        assert not any(f"<{path}>" in line and "no effect" in line for line in notes), notes


def test_every_pair_is_of_an_element_that_is_used():
    used = {f"{owner}/{path}" for owner, path, rule in PATHS if rule.status == USED}
    assert PAIRS.keys() <= used


@pytest.mark.parametrize(
    ("owner", "path"), [(o, p) for o, p, rule in PATHS if rule.status == QUIET]
)
def test_a_quiet_element_changes_nothing_and_is_not_named(owner, path):
    without, with_it = (read(text) for text in with_element(owner, path, ""))
    assert with_it == without


@pytest.mark.parametrize(
    ("owner", "path", "idle"), [(o, p, rule.idle) for o, p, rule in PATHS if rule.status == NAMED]
)
def test_a_named_element_changes_nothing_and_is_named_unless_it_does_nothing(owner, path, idle):
    documents = with_element(owner, path, "7.5" if path not in ("", "static") else "1")
    without, with_it = (read(text) for text in documents)
    assert with_it[0] == without[0]
    [line] = [line for line in with_it[1] if line not in without[1]]
    assert f"<{path}>" in line
    assert "has no effect" in line
    assert ", line " in line
    for value in idle:
        if value != "mu":
            assert read(with_element(owner, path, value)[1])[1] == without[1]


def test_a_kind_of_element_is_named_once_with_its_first_line_and_how_often():
    lazy = CRATE.replace("<link", "\n<self_collide>1</self_collide><link")
    _, notes = read(lazy + lazy.replace("crate", "b") + lazy.replace("crate", "c"))
    assert notes[-1] == "SDF, line 2: <self_collide> in <model> has no effect (3 times)"


def test_second_friction_is_named_where_it_differs_from_the_first():
    text = in_link(collision="").replace("<mu>0.5</mu>", "<mu>0.5</mu><mu2>{}</mu2>")
    named = [bool([n for n in read(text.format(mu))[1] if "mu2" in n]) for mu in (0.5, "0.50", 0.4)]
    assert named == [False, False, True]


def test_unknown_elements_are_named():
    _, notes = read(in_link(collision="<colour>red</colour>"))
    assert any("<colour> in <collision> is unknown and ignored" in line for line in notes)


def test_the_documents_of_this_test_have_no_element_without_effect():
    for text in CONTEXTS.values():
        notes = read(text.replace("{}", ""))[1]
        assert not any("no effect" in line or "unknown" in line for line in notes), notes


def test_the_page_about_elements_is_that_of_the_table(request):
    root = next(folder for folder in request.path.parents if (folder / "docs").is_dir())
    written = (root / "docs" / "elements.md").read_text()
    again = "python -m pioneer_gazebo.world.element_page > docs/elements.md"
    assert written == page(), f"write it again: {again}"
