"""Costmap parameters with costmap_2d's names, in the classic and the plugin (layered) style."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from nav_bundle.costmap.footprint import Footprint, footprint_from_parameters
from pioneer_node.core.live import Live
from pioneer_node.core.parameter import (
    UNKNOWN,
    ParameterError,
    WithoutEffect,
    config_from_mapping,
    value_as,
)

DATA_TYPES = ("LaserScan", "PointCloud", "PointCloud2")
"""Supported message types of an observation source."""
HIGHEST_COLUMN = 16
"""Greatest number of voxels in a column, as in costmap_2d."""


@dataclass(frozen=True)
class SourceConfig:
    """One observation source: a laser scan or a point cloud.

    ``observation_persistence`` [s] is how long an observation keeps marking and clearing; 0 keeps only the newest.
    ``expected_update_rate`` [s] is the longest time without a message that can be used before the source counts as
    stale; 0 disables the check. Ranges [m] apply to this source; heights [m] are in the costmap's frame.
    """

    topic: str
    sensor_frame: str = ""
    observation_persistence: float = 0.0
    expected_update_rate: float = 0.0
    data_type: str = "LaserScan"
    min_obstacle_height: float = 0.0
    max_obstacle_height: float = 2.0
    inf_is_valid: bool = False
    marking: bool = True
    clearing: bool = False
    obstacle_range: float = 2.5
    raytrace_range: float = 3.0


@dataclass(frozen=True)
class StaticConfig:
    """The static layer: a map from ``map_topic``, and with ``subscribe_to_updates`` parts of it from MAP_TOPIC_updates.

    With ``first_map_only`` later maps are ignored.
    """

    enabled: Annotated[bool, Live()] = True
    map_topic: str = "map"
    track_unknown_space: bool = True
    use_maximum: bool = False
    lethal_cost_threshold: int = 100
    unknown_cost_value: int = -1
    trinary_costmap: bool = True
    first_map_only: bool = False
    subscribe_to_updates: bool = False


@dataclass(frozen=True)
class ObstacleConfig:
    """An obstacle layer. ``combination_method`` 1 takes the higher cost, 0 overwrites the layers below.

    ``max_obstacle_height`` [m] is an upper limit for that of every source.
    """

    enabled: Annotated[bool, Live()] = True
    track_unknown_space: bool = False
    footprint_clearing_enabled: Annotated[bool, Live()] = True
    combination_method: Annotated[int, Live(0, 1, (("Overwrite", 0), ("Maximum", 1)))] = 1
    max_obstacle_height: Annotated[float, Live(0.0, 50.0)] = 2.0
    sources: tuple[SourceConfig, ...] = ()


@dataclass(frozen=True)
class VoxelConfig(ObstacleConfig):
    """A voxel layer: an obstacle layer whose cells are columns of ``z_voxels`` voxels (at most 16).

    The lowest voxel begins at ``origin_z`` [m] in the costmap's frame, and each is ``z_resolution`` [m] high. A column
    is an obstacle if more than ``mark_threshold`` of its voxels are marked, else unknown if more than
    ``unknown_threshold`` are unknown, else free.
    """

    origin_z: Annotated[float, Live(0.0)] = 0.0
    z_resolution: Annotated[float, Live(0.0, 50.0)] = 0.2
    z_voxels: Annotated[int, Live(1, HIGHEST_COLUMN)] = 10
    unknown_threshold: Annotated[int, Live(0, HIGHEST_COLUMN)] = 15
    mark_threshold: Annotated[int, Live(0, HIGHEST_COLUMN)] = 0
    publish_voxel_map: Annotated[
        bool, WithoutEffect("is not available: the voxels are not published")
    ] = False


@dataclass(frozen=True)
class InflationConfig:
    """The inflation layer: inflation radius [m] and exponential decay of the cost [1/m]."""

    enabled: Annotated[bool, Live()] = True
    inflation_radius: Annotated[float, Live(0.0, 50.0)] = 0.55
    cost_scaling_factor: Annotated[float, Live(0.0, 100.0)] = 10.0
    inflate_unknown: Annotated[bool, Live()] = False


@dataclass(frozen=True)
class FleetConfig:
    """The fleet layer: marks other robots at their tf poses.

    ``robots`` are their names, as a list or a space-separated string; the costmap's own robot may be among them. Each
    is marked at the tf frame ``<robot>/<base_frame>`` while that transform is at most ``timeout`` [s] old.
    ``footprint`` is the other robots' footprint; if empty, the costmap's own is used.
    """

    enabled: Annotated[bool, Live()] = True
    robots: Any = ""
    base_frame: str = "base_link"
    timeout: Annotated[float, Live(0.0, 60.0)] = 2.0
    footprint: Any = ""
    footprint_padding: float = 0.01

    def frames(self) -> tuple[str, ...]:
        """Returns the frames of the robots."""
        names = self.robots.split() if isinstance(self.robots, str) else self.robots
        return tuple(f"{str(name).strip('/')}/{self.base_frame}" for name in names)


LayerConfig = StaticConfig | ObstacleConfig | FleetConfig | InflationConfig


@dataclass(frozen=True)
class CostmapConfig:
    """A costmap: frames, rates [Hz], size [m] (unless a map sets it), and layers, lowest first, with their names."""

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    update_frequency: Annotated[float, Live(0.0, 100.0)] = 5.0
    publish_frequency: Annotated[float, Live(0.0, 100.0)] = 0.0
    rolling_window: bool = False
    track_unknown_space: bool = False
    always_send_full_costmap: bool = False
    width: Annotated[float, Live(0.0, whole=True)] = 10.0
    height: Annotated[float, Live(0.0, whole=True)] = 10.0
    resolution: Annotated[float, Live(0.0, 50.0)] = 0.05
    origin_x: Annotated[float, Live()] = 0.0
    origin_y: Annotated[float, Live()] = 0.0
    transform_tolerance: Annotated[float, Live(0.0, 10.0)] = 0.3
    footprint: Annotated[Any, Live()] = ""
    robot_radius: Annotated[float, Live(0.0, 10.0)] = 0.46
    footprint_padding: Annotated[float, Live()] = 0.01
    layers: tuple[LayerConfig, ...] = field(default=())
    layer_names: tuple[str, ...] = field(default=(), compare=False)

    def outline(self) -> Footprint:
        """Returns the padded footprint that the parameters describe."""
        return footprint_from_parameters(self.footprint, self.robot_radius, self.footprint_padding)


_LAYERS: dict[str, type[Any]] = {
    "costmap_2d::StaticLayer": StaticConfig,
    "costmap_2d::ObstacleLayer": ObstacleConfig,
    "costmap_2d::VoxelLayer": VoxelConfig,
    "nav_bundle::FleetLayer": FleetConfig,
    "costmap_2d::InflationLayer": InflationConfig,
}
# costmap_2d's layer names when there is no list of plugins, and the name of the fleet layer.
_STATIC, _OBSTACLE, _FLEET, _INFLATION = (
    "static_layer",
    "obstacle_layer",
    "fleet_layer",
    "inflation_layer",
)
_VOXELS = (
    "origin_z",
    "z_resolution",
    "z_voxels",
    "unknown_threshold",
    "mark_threshold",
    "publish_voxel_map",
)
"""costmap_2d's names for three-dimensional maps."""
_OF_STATIC = ("map_topic", "unknown_cost_value", "lethal_cost_threshold", "trinary_costmap")
_OF_OBSTACLES = ("max_obstacle_height", "footprint_clearing_enabled", "combination_method")
_OF_INFLATION = ("inflation_radius", "cost_scaling_factor", "inflate_unknown")
_OF_SOURCES = ("observation_sources", "obstacle_range", "raytrace_range")
_CLASSIC = ("static_map", "map_type")
"""Names that are read only without a list of plugins."""
_OF_LAYERS = frozenset(
    {*_VOXELS, *_OF_STATIC, *_OF_OBSTACLES, *_OF_INFLATION, *_OF_SOURCES, *_CLASSIC, "plugins"}
)
"""costmap_2d's names in a costmap's namespace that set no field of ``CostmapConfig``."""
NAMES = frozenset({each.name for each in fields(CostmapConfig)} | _OF_LAYERS)
"""All names in a costmap's namespace, of ``CostmapConfig`` and of layers."""
_COPIED: dict[type[Any], tuple[str, ...]] = {
    StaticConfig: (
        "map_topic",
        "unknown_cost_value",
        "lethal_cost_threshold",
        "track_unknown_space",
    ),
    ObstacleConfig: (
        "max_obstacle_height",
        "obstacle_range",
        "raytrace_range",
        "track_unknown_space",
    ),
    VoxelConfig: (
        "max_obstacle_height",
        "obstacle_range",
        "raytrace_range",
        "track_unknown_space",
        *_VOXELS,
    ),
    InflationConfig: ("cost_scaling_factor", "inflation_radius"),
    FleetConfig: (),
}
"""With a list of plugins: what a layer takes from the costmap's namespace, as in Noetic."""


def costmap_config_from_parameters(
    parameters: Mapping[str, Any], owner: str, above: Mapping[str, Any] | None = None
) -> CostmapConfig:
    """Returns the configuration in namespace ``owner``.

    A ``plugins`` list of {name, type} defines the layers, each with its own nested parameters; what is missing there is
    taken from the costmap's namespace, as in Noetic. Without the list, ``static_map``, ``observation_sources`` and
    ``inflation_radius`` are read from the costmap's namespace. Parameters in ``static_layer``, ``obstacle_layer`` and
    ``inflation_layer`` then take precedence, as after a reconfiguration, and ``fleet_layer`` adds that layer.

    Args:
        parameters: those in the costmap's namespace.
        owner: that namespace, for messages.
        above: those in the namespaces around it, where ``footprint`` and ``robot_radius`` are looked for, too.

    Raises:
        ParameterError: an unknown layer, a wrong type, or a source with an unsupported data type.
    """
    nested = {name for name, value in parameters.items() if isinstance(value, Mapping)}
    inherited = {
        name: above[name] for name in ("footprint", "robot_radius") if above and name in above
    }
    config = config_from_mapping(
        CostmapConfig, {**inherited, **parameters}, owner, _OF_LAYERS | nested
    )
    layers_of = _listed_layers if parameters.get("plugins") else _classic_layers
    layers = layers_of(parameters, owner)
    config = replace(config, layers=tuple(layers.values()), layer_names=tuple(layers))
    _check(config, owner)
    return config


def _listed_layers(parameters: Mapping[str, Any], owner: str) -> dict[str, LayerConfig]:
    """Returns the layers of a ``plugins`` list, by name; warns of what no layer reads in the costmap's namespace."""
    plugins = parameters["plugins"]
    if not isinstance(plugins, (list, tuple)):
        raise ParameterError(f"{owner}: ~plugins must be a list of {{name, type}}, not {plugins!r}")
    layers = dict(
        _plugin(parameters, plugin, owner) for plugin in plugins if not _is_left_out(plugin, owner)
    )
    copied = {name for layer in layers.values() for name in _COPIED[type(layer)]}
    for name in sorted((_OF_LAYERS - copied - {"plugins"}) & parameters.keys()):
        if name not in layers:
            UNKNOWN.complain(
                f"{owner}: ~{name} is read only without a list of plugins, or in a layer's own namespace"
            )
    return layers


def _is_left_out(plugin: Any, owner: str) -> bool:
    """Returns whether a layer of the list has nothing to do here, with a warning: the obstacle layers do its work."""
    is_footprint = isinstance(plugin, Mapping) and _short(plugin.get("type")) == "FootprintLayer"
    if is_footprint:
        UNKNOWN.complain(
            f"{owner}: ~plugins: {plugin.get('name')} of type {plugin['type']} is left out: "
            "obstacle layers clear the footprint themselves (footprint_clearing_enabled)"
        )
    return is_footprint


def _short(kind: Any) -> str:
    """Returns a layer's type without its package."""
    return str(kind).split("::")[-1]


MOST_CELLS = 10**8
"""Maximum number of cells of a costmap by its parameters: each layer then takes 100 MB. Maps may have more."""


def _check(config: CostmapConfig, owner: str) -> None:
    for name in ("resolution", "width", "height", "update_frequency"):
        if getattr(config, name) <= 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(config, name)}")
    cells = config.width / config.resolution * (config.height / config.resolution)
    if cells > MOST_CELLS:
        raise ParameterError(
            f"{owner}: ~width, ~height and ~resolution give {cells:.3g} cells, above {MOST_CELLS:.0e}"
        )
    footprint_from_parameters(config.footprint, config.robot_radius, config.footprint_padding)


def _classic_layers(parameters: Mapping[str, Any], owner: str) -> dict[str, LayerConfig]:
    map_type = parameters.get("map_type", "costmap")
    if map_type not in ("costmap", "voxel"):
        raise ParameterError(
            f"{owner}: map_type {map_type!r} is not available; there are 'costmap' and 'voxel'"
        )
    kind = VoxelConfig if map_type == "voxel" else ObstacleConfig
    for name in sorted(set(_VOXELS) & parameters.keys()):
        if kind is ObstacleConfig:
            UNKNOWN.complain(f"{owner}: ~{name} is for map_type 'voxel'")
    own = {
        name: {**parameters, **_nested(parameters, name)}
        for name in (_STATIC, _OBSTACLE, _INFLATION)
    }
    layers: dict[str, LayerConfig] = {}
    if value_as(bool, parameters.get("static_map", False), f"{owner}: parameter ~static_map"):
        layers[_STATIC] = _from_matching(StaticConfig, own[_STATIC], owner, {"track_unknown_space"})
        _report_unknown(StaticConfig, _nested(parameters, _STATIC), f"{owner}/{_STATIC}")
    layers[_OBSTACLE] = _obstacles((own[_OBSTACLE],), owner, kind)
    _report_unknown(kind, _nested(parameters, _OBSTACLE), f"{owner}/{_OBSTACLE}")
    if _nested(parameters, _FLEET):
        layers[_FLEET] = config_from_mapping(FleetConfig, parameters[_FLEET], f"{owner}/{_FLEET}")
    layers[_INFLATION] = _from_matching(InflationConfig, own[_INFLATION], owner)
    _report_unknown(InflationConfig, _nested(parameters, _INFLATION), f"{owner}/{_INFLATION}")
    return layers


def _report_unknown(kind: type[Any], own: Mapping[str, Any], owner: str) -> None:
    """Warns of names in a layer's own namespace that the layer does not read; sources are namespaces in it."""
    known = {field.name for field in fields(kind)} - {"sources"}
    has_sources = issubclass(kind, ObstacleConfig)
    if has_sources:
        known |= set(_OF_SOURCES)
    for name, value in own.items():
        if name not in known and not (has_sources and isinstance(value, Mapping)):
            UNKNOWN.report(owner, name, known)


def _nested(parameters: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Returns the parameters in the namespace ``name``; empty if there is no such namespace."""
    found = parameters.get(name)
    return found if isinstance(found, Mapping) else {}


def _from_matching(
    kind: type[Any], parameters: Mapping[str, Any], owner: str, without: Any = ()
) -> Any:
    """Returns a ``kind`` built from the parameters whose names match its fields."""
    names = {f.name for f in fields(kind)} - set(without)
    return config_from_mapping(
        kind, {name: parameters[name] for name in names & set(parameters)}, owner
    )


def _plugin(parameters: Mapping[str, Any], plugin: Any, owner: str) -> tuple[str, LayerConfig]:
    """Returns the layer's name and configuration; the type may omit its package."""
    by_name = {_short(full): kind for full, kind in _LAYERS.items()}
    try:
        name = str(plugin["name"])
        kind = by_name[_short(plugin["type"])]
    except (KeyError, TypeError):
        raise ParameterError(
            f"{owner}: no such layer {plugin!r}; there are {', '.join(_LAYERS)}. Remove it from ~plugins"
            f"{_instead(plugin)}"
        ) from None
    for extra in sorted(str(key) for key in plugin.keys() - {"name", "type"}):
        UNKNOWN.complain(
            f"{owner}: ~plugins: {extra} of {name} is not read in the list; give it as ~{name}/{extra}"
        )
    # A layer may have the name of a parameter, such as static_map, which is no namespace then.
    own = _nested(parameters, name)
    copied = {each: parameters[each] for each in _COPIED[kind] if each in parameters}
    for each in copied.keys() & own.keys():
        if own[each] != copied[each]:
            UNKNOWN.complain(
                f"{owner}: ~{each} is {copied[each]!r}, but ~{name}/{each} is {own[each]!r} and counts"
            )
    layer_owner = f"{owner}/{name}"
    if issubclass(kind, ObstacleConfig):
        _report_unknown(kind, own, layer_owner)
        return name, _obstacles(({**copied, **own}, parameters), layer_owner, kind)
    return name, config_from_mapping(kind, {**copied, **own}, layer_owner)


_INSTEAD = {
    "RangeSensorLayer": ", and give its topics as PointCloud2 to an obstacle layer",
    "SocialLayer": "; people count as obstacles while sensors see them",
    "ProxemicLayer": "; people count as obstacles while sensors see them",
    "PassingLayer": "; people count as obstacles while sensors see them",
}
"""What to do instead of published layers that do not exist here, by class."""


def _instead(plugin: Any) -> str:
    """Returns what to do instead of a layer that does not exist here; empty if that is not known."""
    kind = str(plugin.get("type", "")) if isinstance(plugin, Mapping) else ""
    return _INSTEAD.get(kind.replace("::", "/").split("/")[-1], "")


def _source_names(value: Any, owner: str) -> list[str]:
    """Returns the names in ``observation_sources``: separated by spaces, or as a list."""
    if isinstance(value, str):
        return value.split()
    if isinstance(value, (list, tuple)) and all(isinstance(name, str) for name in value):
        return list(value)
    raise ParameterError(
        f"{owner}: ~observation_sources must be names separated by spaces, not {value!r}"
    )


def _obstacles(
    scopes: Sequence[Mapping[str, Any]], owner: str, kind: type[ObstacleConfig]
) -> ObstacleConfig:
    """Returns the layer described in ``scopes[0]``; a source's missing parameters come from the outer scopes."""
    own = scopes[0]
    names = _source_names(own.get("observation_sources", ""), owner)
    layer = _from_matching(kind, own, owner, {"sources"})
    if isinstance(layer, VoxelConfig):
        layer = _checked_column(layer, owner)
    if "track_unknown_space" not in own:
        what = f"{owner}: parameter ~track_unknown_space"
        layer = replace(
            layer,
            track_unknown_space=value_as(bool, scopes[-1].get("track_unknown_space", False), what),
        )
    sources = (_source(name, scopes, owner) for name in names)
    highest = layer.max_obstacle_height
    return replace(
        layer,
        sources=tuple(
            replace(source, max_obstacle_height=min(source.max_obstacle_height, highest))
            for source in sources
        ),
    )


def _checked_column(layer: VoxelConfig, owner: str) -> VoxelConfig:
    if layer.z_resolution <= 0.0:
        raise ParameterError(f"{owner}: ~z_resolution must be positive, not {layer.z_resolution}")
    count = min(max(layer.z_voxels, 1), HIGHEST_COLUMN)
    if count != layer.z_voxels:
        UNKNOWN.correct(f"{owner}: ~z_voxels is {layer.z_voxels}, taken as {count}")
    return replace(layer, z_voxels=count)


def _source(name: str, scopes: Sequence[Mapping[str, Any]], owner: str) -> SourceConfig:
    own: Mapping[str, Any] = next(
        (scope[name] for scope in scopes if isinstance(scope.get(name), Mapping)), {}
    )
    values = {"topic": name, **own}
    for inherited in ("obstacle_range", "raytrace_range"):
        outer = next((scope[inherited] for scope in scopes if inherited in scope), None)
        if outer is not None:
            values.setdefault(inherited, outer)
    source = config_from_mapping(SourceConfig, values, f"{owner}/{name}")
    if source.data_type not in DATA_TYPES:
        known = ", ".join(DATA_TYPES)
        raise ParameterError(
            f"{owner}/{name}: data_type {source.data_type!r} is not available; there are {known}"
        )
    if source.observation_persistence < 0.0:
        raise ParameterError(f"{owner}/{name}: observation_persistence must not be negative")
    return source
