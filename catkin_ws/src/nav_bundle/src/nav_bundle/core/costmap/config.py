"""Costmap parameters with costmap_2d's names, in the classic and the plugin (layered) style."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from nav_bundle.core.costmap.footprint import Footprint, footprint_from_parameters
from pioneer_node.core.live import Live
from pioneer_node.core.parameter import ParameterError, config_from_mapping

DATA_TYPES = ("LaserScan", "PointCloud2")
"""Supported message types of an observation source."""


@dataclass(frozen=True)
class SourceConfig:
    """One observation source: a laser scan or a point cloud.

    ``observation_persistence`` [s] is how long an observation keeps marking and clearing; 0 keeps only the newest.
    ``expected_update_rate`` [s] is the longest time between messages before the source counts as stale; 0 disables
    the check. Ranges [m] apply to this source; heights [m] are in the costmap's frame.
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
    """The static layer: a map from ``map_topic``."""

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


_LAYERS = {
    "costmap_2d::StaticLayer": StaticConfig,
    "costmap_2d::ObstacleLayer": ObstacleConfig,
    "nav_bundle::FleetLayer": FleetConfig,
    "costmap_2d::InflationLayer": InflationConfig,
}
# costmap_2d's layer names when there is no list of plugins, and the name of the fleet layer.
_STATIC, _OBSTACLE, _FLEET, _INFLATION = "static_layer", "obstacle_layer", "fleet_layer", "inflation_layer"
# costmap_2d's names that set no field of ``CostmapConfig``: three-dimensional maps, retired options, and parameters
# that the layers read.
_WITHOUT_EFFECT = frozenset(
    {
        "origin_z",
        "z_resolution",
        "z_voxels",
        "unknown_threshold",
        "mark_threshold",
        "publish_voxel_map",
        "observation_sources",
        "map_type",
        "static_map",
        "max_obstacle_height",
        "obstacle_range",
        "raytrace_range",
        "inflation_radius",
        "cost_scaling_factor",
        "plugins",
        "lethal_cost_threshold",
        "unknown_cost_value",
        "trinary_costmap",
        "map_topic",
        "footprint_clearing_enabled",
        "combination_method",
        "inflate_unknown",
    }
)


def costmap_config_from_parameters(parameters: Mapping[str, Any], owner: str) -> CostmapConfig:
    """Returns the configuration in namespace ``owner``.

    A ``plugins`` list of {name, type} defines the layers, each with its own nested parameters. Without the list,
    ``static_map``, ``observation_sources`` and ``inflation_radius`` are read from the costmap's namespace. Parameters
    in ``static_layer``, ``obstacle_layer`` and ``inflation_layer`` then take precedence, as after a reconfiguration,
    and ``fleet_layer`` adds that layer.

    Raises:
        ParameterError: an unknown name or layer, a wrong type, or a source with an unsupported data type.
    """
    nested = {name for name, value in parameters.items() if isinstance(value, Mapping)}
    config = config_from_mapping(CostmapConfig, parameters, owner, _WITHOUT_EFFECT | nested)
    if parameters.get("plugins"):
        layers = dict(_plugin(parameters, plugin, owner) for plugin in parameters["plugins"])
    else:
        layers = _classic_layers(parameters, owner)
    config = replace(config, layers=tuple(layers.values()), layer_names=tuple(layers))
    _check(config, owner)
    return config


def _check(config: CostmapConfig, owner: str) -> None:
    for name in ("resolution", "width", "height", "update_frequency"):
        if getattr(config, name) <= 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(config, name)}")
    footprint_from_parameters(config.footprint, config.robot_radius, config.footprint_padding)


def _classic_layers(parameters: Mapping[str, Any], owner: str) -> dict[str, LayerConfig]:
    if parameters.get("map_type", "costmap") != "costmap":
        raise ParameterError(f"{owner}: map_type {parameters['map_type']!r} is not available, only 'costmap' is")
    own = {name: {**parameters, **_nested(parameters, name)} for name in (_STATIC, _OBSTACLE, _INFLATION)}
    layers: dict[str, LayerConfig] = {}
    if parameters.get("static_map", False):
        layers[_STATIC] = _from_matching(StaticConfig, own[_STATIC], owner, {"track_unknown_space"})
    layers[_OBSTACLE] = _obstacles((own[_OBSTACLE],), owner)
    if _nested(parameters, _FLEET):
        layers[_FLEET] = config_from_mapping(FleetConfig, parameters[_FLEET], f"{owner}/{_FLEET}")
    layers[_INFLATION] = _from_matching(InflationConfig, own[_INFLATION], owner)
    return layers


def _nested(parameters: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Returns the parameters in the namespace ``name``; empty if there is no such namespace."""
    found = parameters.get(name)
    return found if isinstance(found, Mapping) else {}


def _from_matching(kind: type[Any], parameters: Mapping[str, Any], owner: str, without: Any = ()) -> Any:
    """Returns a ``kind`` built from the parameters whose names match its fields."""
    names = {f.name for f in fields(kind)} - set(without)
    return config_from_mapping(kind, {name: parameters[name] for name in names & set(parameters)}, owner)


def _plugin(parameters: Mapping[str, Any], plugin: Any, owner: str) -> tuple[str, LayerConfig]:
    """Returns the layer's name and configuration; the type may omit its package."""
    by_name = {full.split("::")[-1]: kind for full, kind in _LAYERS.items()}
    try:
        name, kind = str(plugin["name"]), by_name[str(plugin["type"]).split("::")[-1]]
    except (KeyError, TypeError):
        raise ParameterError(f"{owner}: no such layer {plugin!r}; there are {', '.join(_LAYERS)}") from None
    own = parameters.get(name, {})
    layer_owner = f"{owner}/{name}"
    if kind is ObstacleConfig:
        return name, _obstacles((own, parameters), layer_owner)
    return name, config_from_mapping(kind, own, layer_owner)


def _obstacles(scopes: Sequence[Mapping[str, Any]], owner: str) -> ObstacleConfig:
    """Returns the layer described in ``scopes[0]``; a source's missing parameters come from the outer scopes."""
    own = scopes[0]
    names = own.get("observation_sources", "").split()
    layer = _from_matching(ObstacleConfig, own, owner, {"sources"})
    if "track_unknown_space" not in own:
        layer = replace(layer, track_unknown_space=bool(scopes[-1].get("track_unknown_space", False)))
    sources = (_source(name, scopes, owner) for name in names)
    highest = layer.max_obstacle_height
    return replace(
        layer,
        sources=tuple(
            replace(source, max_obstacle_height=min(source.max_obstacle_height, highest)) for source in sources
        ),
    )


def _source(name: str, scopes: Sequence[Mapping[str, Any]], owner: str) -> SourceConfig:
    own: Mapping[str, Any] = next((scope[name] for scope in scopes if isinstance(scope.get(name), Mapping)), {})
    values = {"topic": name, **own}
    for inherited in ("obstacle_range", "raytrace_range"):
        outer = next((scope[inherited] for scope in scopes if inherited in scope), None)
        if outer is not None:
            values.setdefault(inherited, outer)
    source = config_from_mapping(SourceConfig, values, f"{owner}/{name}")
    if source.data_type not in DATA_TYPES:
        known = ", ".join(DATA_TYPES)
        raise ParameterError(f"{owner}/{name}: data_type {source.data_type!r} is not available; there are {known}")
    if source.observation_persistence < 0.0:
        raise ParameterError(f"{owner}/{name}: observation_persistence must not be negative")
    return source
