"""Results of a robot's tour of waypoints, and the navigation bench's rows made from tours."""

import dataclasses
from collections.abc import Iterator, Sequence

from pioneer_bench.core.row import Row


@dataclasses.dataclass(frozen=True, slots=True)
class Condition:
    """How the robot localises during a tour, and the goals for that."""

    title: str  #: prefix of its rows
    odometry_scale: float = 1.0  #: wheel diameter assumed by the encoders, relative to the true one
    #: whether the robot maps with slam_gmapping instead of localising with amcl in a given map
    mapping: bool = False
    mean: float | None = None  #: greatest mean localisation error of a tour [m]; None for no goal
    p95: float | None = None  #: greatest 95th percentile of that error [m]; None for no goal
    #: the C++ stack's mean and 95th percentile [m]; None if not measured
    peer: tuple[float, float] | None = None


CONDITIONS = {
    "perfect": Condition("perfect odometry", mean=0.04, peer=(0.039, 0.080)),
    "scaled": Condition("odometry 3 % too long", 1.03, mean=0.10, p95=0.20, peer=(0.098, 0.20)),
    "mapping": Condition("slam_gmapping", mapping=True),
}

PEER_SECONDS = 260.0
"""Time of the C++ stack for twelve waypoints, 160 m, in Stage and in another maze [s]."""
COST_GOAL, RSS_GOAL = 0.24, 160.0
"""Limits for amcl and move_base together: CPU-s a simulated second, MB."""


@dataclasses.dataclass(frozen=True, slots=True)
class Tour:
    """One robot's tour."""

    condition: str  #: name of the condition
    seed: int  #: of waypoints and noise
    waypoints: int  #: waypoints sent
    reached: int  #: waypoints reached
    seconds: float  #: simulated time from sending the waypoints until the last one was reached or given up [s]
    wall: float  #: the same in wall time [s]
    way: float  #: path length driven [m]
    shortest: float  #: shortest path length between the waypoints in the map [m]
    collisions: int  #: number of collisions, with anything
    clearance: float  #: least distance of base_link from a wall [m]
    #: error_mean, error_p95, error_max: distance between estimated and true position [m]
    error_mean: float
    error_p95: float
    error_max: float
    cpu: dict[str, float]  #: CPU-s a simulated second by kind of process
    rss: dict[str, float]  #: largest resident memory by kind of process [MB]
    map_iou: float | None = None  #: IoU of the drawn and the true map, 0 … 1; None without mapping
    fault: str = ""  #: what went wrong; empty if nothing did

    def summary(self) -> str:
        """Returns a summary in one line."""
        line = (
            f"{self.reached} of {self.waypoints} in {self.seconds:.0f} s, {self.way:.0f} m, "
            f"{self.collisions} collisions, error mean {self.error_mean:.3f} m, p95 {self.error_p95:.3f} m, "
            f"real-time factor {self.seconds / self.wall:.1f}"
        )
        return f"{line}; {self.fault}" if self.fault else line


def tour_rows(condition: Condition, tours: Sequence[Tour]) -> list[Row]:
    """Returns the rows of one condition, with one sample per tour."""
    title = condition.title
    mean_peer, p95_peer = condition.peer or (None, None)

    def samples(name: str) -> tuple[float, ...]:
        return tuple(float(getattr(tour, name)) for tour in tours)

    rows = [
        Row(
            f"{title}: waypoints reached",
            "",
            (sum(samples("reached")),),
            sum(samples("waypoints")),
            True,
            "all",
        ),
        Row(f"{title}: collisions", "", (sum(samples("collisions")),), 0.0),
        Row(f"{title}: time of a tour", "s", samples("seconds")),
        Row(f"{title}: way of a tour", "m", samples("way")),
        Row(f"{title}: speed on the way", "m/s", tuple(tour.way / tour.seconds for tour in tours)),
        Row(
            f"{title}: way over the shortest", "", tuple(tour.way / tour.shortest for tour in tours)
        ),
        Row(f"{title}: least clearance of base_link", "m", samples("clearance")),
        Row(
            f"{title}: error, mean",
            "m",
            samples("error_mean"),
            condition.mean,
            False,
            _peer(mean_peer),
            True,
        ),
        Row(
            f"{title}: error, p95",
            "m",
            samples("error_p95"),
            condition.p95,
            False,
            _peer(p95_peer),
            True,
        ),
        Row(f"{title}: error, greatest", "m", samples("error_max")),
    ]
    maps = tuple(tour.map_iou for tour in tours if tour.map_iou is not None)
    return [
        *rows,
        *_cost_rows(condition, tours),
        *([Row(f"{title}: map IoU", "", maps)] if maps else []),
    ]


def _cost_rows(condition: Condition, tours: Sequence[Tour]) -> Iterator[Row]:
    own = "slam_gmapping" if condition.mapping else "amcl"
    cost, rss = (None, None) if condition.mapping else (COST_GOAL, RSS_GOAL)
    for what, kinds in ((own, [own]), ("move_base", ["move_base"]), ("both", [own, "move_base"])):
        spent = tuple(sum(tour.cpu[kind] for kind in kinds) for tour in tours)
        memory = tuple(sum(tour.rss[kind] for kind in kinds) for tour in tours)
        both = what == "both"
        yield Row(f"{condition.title}: {what}", "CPU-s/sim-s", spent, cost if both else None)
        yield Row(f"{condition.title}: {what}", "MB", memory, rss if both else None)


def _peer(value: float | None) -> str:
    return "" if value is None else f"C++ {value:g}"
