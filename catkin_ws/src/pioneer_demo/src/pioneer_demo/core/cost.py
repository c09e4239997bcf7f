"""Resource usage of processes."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Cost:
    """CPU time [s] and peak resident memory [bytes] of the processes of one kind."""

    cpu: float
    rss: int
    processes: int
