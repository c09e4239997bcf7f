"""Parameters of a costmap, under costmap_2d's names, in its classic and in its layered style."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from nav_bundle.core.costmap.footprint import Footprint, footprint_from_parameters
from pioneer_node.core.parameter import ParameterError, config_from_mapping

DATA_TYPES = ("LaserScan", "PointCloud2")
"""What a source may send."""


@dataclass(frozen=True)
class SourceConfig:
    """One observation source: a laser, or points in space.

    ``observation_persistence`` [s] is how long what was seen goes on marking and clearing, 0 for the newest alone.
    ``expected_update_rate`` [s] is the longest silence that still counts as current, 0 for any.
    Ranges [m] hold for this source; heights [m] are in the costmap's frame.
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

    enabled: bool = True
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
    """An obstacle layer. ``combination_method`` 1 takes the higher cost, 0 overwrites what lies below."""

    enabled: bool = True
    track_unknown_space: bool = False
    footprint_clearing_enabled: bool = True
    combination_method: int = 1
    max_obstacle_height: float = 2.0
    sources: tuple[SourceConfig, ...] = ()


@dataclass(frozen=True)
class InflationConfig:
    """The inflation layer: how far [m] costs reach and how fast [1/m] they fall."""

    enabled: bool = True
    inflation_radius: float = 0.55
    cost_scaling_factor: float = 10.0
    inflate_unknown: bool = False


LayerConfig = StaticConfig | ObstacleConfig | InflationConfig


@dataclass(frozen=True)
class CostmapConfig:
    """A costmap: frames, rates [Hz], size [m] where no map gives it, and its layers, lowest first."""

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    update_frequency: float = 5.0
    publish_frequency: float = 0.0
    rolling_window: bool = False
    track_unknown_space: bool = False
    always_send_full_costmap: bool = False
    width: float = 10.0
    height: float = 10.0
    resolution: float = 0.05
    origin_x: float = 0.0
    origin_y: float = 0.0
    transform_tolerance: float = 0.3
    footprint: Any = ""
    robot_radius: float = 0.46
    footprint_padding: float = 0.01
    layers: tuple[LayerConfig, ...] = field(default=())

    def outline(self) -> Footprint:
        """Returns the footprint that the parameters describe, padded."""
        return footprint_from_parameters(self.footprint, self.robot_radius, self.footprint_padding)


_LAYERS = {"StaticLayer": StaticConfig, "ObstacleLayer": ObstacleConfig, "InflationLayer": InflationConfig}
# Names that costmap_2d has and that change nothing here: three-dimensional maps and retired switches.
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

    A ``plugins`` list of {name, type} gives the layers, each with its own nested names; without one,
    ``static_map``, ``observation_sources`` and ``inflation_radius`` stand in the costmap's namespace.

    Raises:
        ParameterError: an unknown name or layer, a wrong type, a source of an unknown type, a rolling static map.
    """
    nested = {name for name, value in parameters.items() if isinstance(value, Mapping)}
    config = config_from_mapping(CostmapConfig, parameters, owner, _WITHOUT_EFFECT | nested)
    if parameters.get("plugins"):
        layers = tuple(_plugin(parameters, plugin, owner) for plugin in parameters["plugins"])
    else:
        layers = _classic_layers(parameters, owner)
    config = replace(config, layers=layers)
    _check(config, owner)
    return config


def _check(config: CostmapConfig, owner: str) -> None:
    if config.rolling_window and any(isinstance(layer, StaticConfig) for layer in config.layers):
        raise ParameterError(f"{owner}: a rolling window cannot have a static map; set static_map or rolling_window")
    for name in ("resolution", "width", "height", "update_frequency"):
        if getattr(config, name) <= 0.0:
            raise ParameterError(f"{owner}: ~{name} must be positive, not {getattr(config, name)}")
    footprint_from_parameters(config.footprint, config.robot_radius, config.footprint_padding)


def _classic_layers(parameters: Mapping[str, Any], owner: str) -> tuple[LayerConfig, ...]:
    if parameters.get("map_type", "costmap") != "costmap":
        raise ParameterError(f"{owner}: map_type {parameters['map_type']!r} is not available, only 'costmap' is")
    layers: list[LayerConfig] = []
    if parameters.get("static_map", False):
        layers.append(_from_matching(StaticConfig, parameters, owner, {"track_unknown_space"}))
    layers.append(_obstacles((parameters,), owner))
    layers.append(_from_matching(InflationConfig, parameters, owner))
    return tuple(layers)


def _from_matching(kind: type[Any], parameters: Mapping[str, Any], owner: str, without: Any = ()) -> Any:
    """Returns ``kind`` from those parameters that are named like its fields."""
    names = {f.name for f in fields(kind)} - set(without)
    return config_from_mapping(kind, {name: parameters[name] for name in names & set(parameters)}, owner)


def _plugin(parameters: Mapping[str, Any], plugin: Any, owner: str) -> LayerConfig:
    try:
        name, kind = plugin["name"], _LAYERS[str(plugin["type"]).split("::")[-1]]
    except (KeyError, TypeError):
        known = ", ".join(f"costmap_2d::{layer}" for layer in _LAYERS)
        raise ParameterError(f"{owner}: no such layer {plugin!r}; there are {known}") from None
    own = parameters.get(name, {})
    layer_owner = f"{owner}/{name}"
    if kind is ObstacleConfig:
        return _obstacles((own, parameters), layer_owner)
    return config_from_mapping(kind, own, layer_owner)


def _obstacles(scopes: Sequence[Mapping[str, Any]], owner: str) -> ObstacleConfig:
    """Returns the layer described in ``scopes[0]``; what a source leaves out is looked up outwards."""
    own = scopes[0]
    names = own.get("observation_sources", "").split()
    sources = tuple(_source(name, scopes, owner) for name in names)
    layer = _from_matching(ObstacleConfig, own, owner, {"sources"})
    if "track_unknown_space" not in own:
        layer = replace(layer, track_unknown_space=bool(scopes[-1].get("track_unknown_space", False)))
    return replace(layer, sources=sources)


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
