"""The simulator's results: what one run measured, its goals, and the table of both."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pioneer_bench.core.row import markdown

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
        goals = {name: {"goal": goal, "holds": holds} for name, (goal, holds) in self.goals().items()}
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
