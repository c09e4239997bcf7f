"""Parameters of the right of way, the same for all robots of a fleet."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CoordinatorConfig:
    """Times [s] and distances [m]."""

    horizon: int = 3  #: number of places that a robot takes ahead
    #: distance at which a place or the waypoint counts as reached: a bit more than the navigation's goal tolerance
    reach: float = 0.3
    lease: float = (
        2.0  #: a robot silent for longer counts as lost: an obstacle at its last reported position
    )
    patience: float = 20.0  #: time-out at the start for expected robots
    replan_period: float = 0.4  #: minimum time between two plans of one robot
    #: distance from what it holds above which a robot counts as an obstacle at its position: at least 1.5 ``reach``
    stray: float = 0.45
    carried: float = (
        1.0  #: distance from what it holds above which a robot has been carried elsewhere
    )
    memory: float = 300.0  #: a robot silent for longer is forgotten
    speed: float = 1.2  #: highest speed of the robots [m/s]: how far a silent one may have come


@dataclass(frozen=True)
class PilotConfig(CoordinatorConfig):
    """Bounds of a goal; times [s].

    ``retries``: how often a stop that move_base gave up is sent again before the goal is aborted.
    ``stall``: how long the robot waits while neither it nor another robot moves. ``limit``: of the whole goal.
    """

    retries: int = 3
    stall: float = 60.0
    limit: float = 3600.0
