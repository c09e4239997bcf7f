"""Settings of the simulator's bench: rates and beams by name, and the peers' figures at the same rates."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Rates:
    """Sensor and publishing rates of one setting."""

    title: str  #: heading of the table
    robots: tuple[int, ...]  #: numbers of robots to run
    beams: int = 180  #: per scan
    scan_rate: float = 10.0  #: [Hz]
    odometry_rate: float = 50.0  #: of odom and tf [Hz]
    other_rate: float = 0.0  #: of joint states and ground truth [Hz]; 0: without subscribers
    clock_rate: float = 100.0  #: of ``/clock`` [Hz]
    real_time_factor: float = 1.0  #: to hold; 0: as fast as possible
    goals: dict[int, float] = field(default_factory=dict)  #: greatest CPU-s a simulated second, by number of robots
    least_factor: float | None = None  #: least real-time factor
    #: cost of the peer, CPU-s a simulated second, by number of robots
    peers: dict[int, float] = field(default_factory=dict)
    peer: str = ""  #: its name, and how it was run


_GAZEBO = "Gazebo Classic 11.1 at its default step, publishing nothing"
_STAGE = "Stage (2-D, no wheels, no contacts), every topic subscribed; the goal is 1.5 times its cost"

SETTINGS = {
    "fleet": Rates(
        "Fleet: 180 beams at 10 Hz, odometry and tf at 50 Hz",
        (1, 2, 5, 10, 20, 50),
        goals={5: 0.06, 20: 0.25, 50: 0.65},
        peers={1: 0.080, 5: 0.341, 10: 0.720, 20: 1.57, 50: 4.32},
        peer=_GAZEBO,
    ),
    "fleet-all": Rates(
        "The same with joint states and ground truth at 20 Hz", (5, 50), other_rate=20.0,
        peers={5: 0.341, 50: 4.32}, peer=_GAZEBO,
    ),
    "original": Rates(
        "The original's sensors: 720 beams at 40 Hz, odometry at 100 Hz", (10,), 720, 40.0, 100.0, 20.0
    ),
    "original-fast": Rates(
        "The original's sensors, as fast as possible; subscribers, on the same cores, may lose messages",
        (10,), 720, 40.0, 100.0, 20.0, real_time_factor=0.0, least_factor=1.0,
    ),
    "stage": Rates(
        "Stage's rates: everything at 10 Hz, 180 beams", (10, 50), 180, 10.0, 10.0, 10.0, 10.0,
        goals={50: 0.369}, peers={10: 0.050, 50: 0.246}, peer=_STAGE,
    ),
    "stage-640": Rates(
        "Stage's rates with 640 beams", (50,), 640, 10.0, 10.0, 10.0, 10.0,
        goals={50: 0.972}, peers={50: 0.648}, peer=_STAGE,
    ),
}  # fmt: skip
"""The settings by name. Peers were measured on another day, so ratios of their figures hold better than the figures."""
