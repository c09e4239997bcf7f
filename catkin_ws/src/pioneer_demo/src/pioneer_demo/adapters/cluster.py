"""Executes a study's runs on dask.distributed: local workers, or those of an existing scheduler."""

import queue
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import dask
import distributed

from pioneer_demo.adapters.study_run import run_scenario
from pioneer_demo.core.error import DemoError
from pioneer_demo.core.study import Run

_CLOSING = 15.0


class ClusterError(DemoError):
    """The scheduler cannot be reached, or its workers do not finish a run."""


class Cluster:
    """Distributes runs to workers; a run whose worker dies is reassigned. A context manager."""

    def __init__(self, scheduler: str, jobs: int) -> None:
        """Connects to ``scheduler``; if it is empty, starts ``jobs`` local workers.

        Raises:
            ClusterError: there is no such scheduler.
        """
        # A worker busy with a fleet may answer slowly; do not give it up for that.
        dask.config.set({"distributed.scheduler.allowed-failures": 5, "distributed.comm.timeouts.connect": "60s"})
        self._local: distributed.LocalCluster | None = None
        if not scheduler:
            # One thread per worker: the fleet's parent-death signal fires when the thread that started it ends.
            self._local = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
            )
        try:
            self._client = distributed.Client(self._local or scheduler, timeout=30)
        except (OSError, TimeoutError) as error:
            raise ClusterError(f"no scheduler at {scheduler}: {error}") from None
        self._futures = list[distributed.Future]()

    @property
    def workers(self) -> int:
        """Number of workers."""
        return len(self._client.ncores())

    def results(
        self, program: Sequence[str], scenarios: Mapping[Run, str], keep: Mapping[Run, str], poll: float
    ) -> Iterator[tuple[Run, dict[str, Any] | str] | None]:
        """Executes all runs; yields each with its row, or an error text if it failed.

        Yields None every ``poll`` [s] while waiting.
        """
        runs, done = {run.name: run for run in scenarios}, queue.SimpleQueue[distributed.Future]()
        for number, (run, scenario) in enumerate(scenarios.items()):
            future = self._client.submit(
                run_scenario, list(program), scenario, run, keep[run], key=run.name, pure=False, priority=-number,
                retries=0,
            )  # fmt: skip
            self._futures.append(future)
            future.add_done_callback(done.put)
        left = len(runs)
        while left:
            try:
                future = done.get(timeout=poll)
            except queue.Empty:
                yield None
                continue
            left -= 1
            error = future.exception()
            yield runs[future.key], (future.result() if error is None else f"{type(error).__name__}: {error}")

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        self._client.cancel(self._futures, force=True)
        self._client.close()
        if self._local is not None:
            self._local.close(timeout=_CLOSING)
