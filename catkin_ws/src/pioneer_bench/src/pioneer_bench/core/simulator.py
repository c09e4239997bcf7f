"""The simulator's bench: its settings with their peers' figures, what one run measured, its goals, and the table."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from pioneer_bench.core.row import markdown


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
    goals: dict[int, float] = field(
        default_factory=dict
    )  #: greatest CPU-s a simulated second, by number of robots
    least_factor: float | None = None  #: least real-time factor
    #: cost of the peer, CPU-s a simulated second, by number of robots
    peers: dict[int, float] = field(default_factory=dict)
    peer: str = ""  #: its name, and how it was run


_GAZEBO = "Gazebo Classic 11.1 at its default step, publishing nothing"
_STAGE = (
    "Stage (2-D, no wheels, no contacts), every topic subscribed; the goal is 1.5 times its cost"
)

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

FIRST_STEP_GOAL = 1.0
"""CPU time from exec to the first step [CPU-s]."""

RSS_GOAL, RSS_GOAL_PER_ROBOT = 150.0, 1.0
"""Resident memory of the process, and the extra for each robot [MB]."""


@dataclass(frozen=True, slots=True)
class Run:
    """Results of one run."""

    robots: int  #: number of robots
    beams: int  #: per scan
    scan_rate: float  #: [Hz]
    simulated: float  #: length of the window [simulated s]
    wall: float  #: length of the window [wall s]
    cpu: float  #: used by the simulator's process in the window [CPU-s]
    first_step: float  #: from exec to the first tick, without robots [CPU-s]
    rss: float  #: of the process at the end [MB]
    scans: int  #: scans that arrived
    scans_due: int  #: scans that should have arrived
    messages: float  #: received on all topics, per simulated second
    #: requested real-time factor; 0: as fast as possible, in which case subscribers may lose messages
    asked_factor: float = 1.0
    cost_goal: float | None = None  #: greatest CPU-s a simulated second; None for no goal
    factor_goal: float | None = None  #: least real-time factor; None for no goal

    @property
    def factor(self) -> float:
        """The achieved real-time factor."""
        return self.simulated / self.wall

    @property
    def cost(self) -> float:
        """CPU-s a simulated second."""
        return self.cpu / self.simulated

    def goals(self) -> dict[str, tuple[float, bool]]:
        """Returns the goals that apply (of cost, factor, first_step, rss, scans), each with whether it is met."""
        goals = {"first_step": (FIRST_STEP_GOAL, self.first_step <= FIRST_STEP_GOAL)}
        most = RSS_GOAL + RSS_GOAL_PER_ROBOT * self.robots
        goals["rss"] = (most, self.rss <= most)
        if self.asked_factor > 0:
            goals["scans"] = (float(self.scans_due), self.scans >= self.scans_due)
        if self.cost_goal is not None:
            goals["cost"] = (self.cost_goal, self.cost <= self.cost_goal)
        if self.factor_goal is not None:
            goals["factor"] = (self.factor_goal, self.factor >= self.factor_goal)
        return goals

    def as_dict(self) -> dict[str, Any]:
        """Returns the run and its goals for JSON."""
        goals = {
            name: {"goal": goal, "holds": holds} for name, (goal, holds) in self.goals().items()
        }
        return {**asdict(self), "cost": self.cost, "factor": self.factor, "goals": goals}


HEADINGS = (
    "robots", "beams", "CPU-s/sim-s", "goal", "peer", "ratio", "rtf", "RSS MB", "goal", "scans", "first step",
    "msg/sim-s",
)  # fmt: skip


def table(runs: Sequence[Run], peers: Mapping[int, float]) -> str:
    """Returns the runs as a Markdown table, beside a peer's cost by number of robots; ``!`` marks a missed goal."""
    return markdown([HEADINGS, *(_row(run, peers.get(run.robots)) for run in runs)], right=True)


def _row(run: Run, peer: float | None) -> tuple[str, ...]:
    goals = run.goals()

    def marked(name: str, text: str) -> str:
        return text if goals.get(name, (0.0, True))[1] else f"{text} !"

    cost_goal = f"{run.cost_goal:.3g}" if run.cost_goal is not None else "-"
    return (
        str(run.robots),
        f"{run.beams} @ {run.scan_rate:g}",
        marked("cost", f"{run.cost:.4f}"),
        cost_goal,
        "-" if peer is None else f"{peer:.3f}",
        "-" if peer is None else f"{run.cost / peer:.2f}",
        marked("factor", f"{run.factor:.2f}"),
        marked("rss", f"{run.rss:.0f}"),
        f"{goals['rss'][0]:.0f}",
        marked("scans", f"{run.scans}/{run.scans_due}"),
        marked("first_step", f"{run.first_step:.2f}"),
        f"{run.messages:.0f}",
    )
