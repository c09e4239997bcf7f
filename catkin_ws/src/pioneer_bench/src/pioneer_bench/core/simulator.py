"""The simulator's figures: what one run measured, what it is to reach, and the table of both."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pioneer_bench.core.row import markdown

FIRST_STEP_GOAL = 1.0
"""CPU-s from exec to the first step."""

RSS_GOAL, RSS_GOAL_PER_ROBOT = 150.0, 1.0
"""MB of the process, and more for each robot."""


@dataclass(frozen=True, slots=True)
class Run:
    """What one run measured."""

    robots: int  #: how many drove
    beams: int  #: of a scan
    scan_rate: float  #: [Hz]
    simulated: float  #: length of the window [simulated s]
    wall: float  #: the same [s]
    cpu: float  #: all threads of the simulator's process in the window [CPU-s]
    first_step: float  #: from exec to the first tick, without robots [CPU-s]
    rss: float  #: of the process at the end [MB]
    scans: int  #: how many arrived
    scans_due: int  #: how many should have
    messages: float  #: of all topics that arrived, a simulated second
    #: real-time factor that was asked for; 0: as fast as possible, where subscribers may lose messages
    asked_factor: float = 1.0
    cost_goal: float | None = None  #: CPU-s a simulated second to reach; None where there is none
    factor_goal: float | None = None  #: real-time factor to reach; None where there is none

    @property
    def factor(self) -> float:
        """The real-time factor."""
        return self.simulated / self.wall

    @property
    def cost(self) -> float:
        """CPU-s a simulated second."""
        return self.cpu / self.simulated

    def goals(self) -> dict[str, tuple[float, bool]]:
        """Returns each goal that applies, with whether it holds: cost, factor, first_step, rss, scans."""
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
        """Returns the run with its goals, for JSON."""
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
