"""Executes a study's runs on dask.distributed: local workers, or those of an existing scheduler."""

import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import dask
import distributed

from pioneer_demo.console.interrupt import Interrupt
from pioneer_demo.error import DemoError
from pioneer_demo.study.run import run_scenario
from pioneer_demo.study.study import Run

_START, _CLOSING, _ANSWER = 90.0, 15.0, 60.0
_NO_WORKER = 120.0
"""Time after which a scheduler without workers ends the study [s]; a killed worker is started again sooner."""
_SETTINGS = {
    # A worker busy with a fleet may answer slowly; do not give it up for that.
    "distributed.scheduler.allowed-failures": 5,
    "distributed.comm.timeouts.connect": "60s",
    # The scratch folder belongs to one study: with locks, a start waits for those of others, without an end.
    "distributed.worker.use-file-locking": False,
}

Value = TypeVar("Value")


class ClusterError(DemoError):
    """The scheduler cannot be reached, or its workers do not finish a run."""


class Cluster:
    """Distributes runs to workers; a run whose worker dies is reassigned. A context manager."""

    def __init__(self, scheduler: str, jobs: int, scratch: Path, interrupt: Interrupt) -> None:
        """Connects to ``scheduler``; if it is empty, starts ``jobs`` local workers.

        Args:
            scheduler: its address.
            jobs: number of local workers.
            scratch: folder for the local workers' files; no other study uses it.
            interrupt: ends the start.

        Raises:
            ClusterError: there is no such scheduler, it has no workers, or none start.
            Interrupted: the user has asked for the end.
        """
        dask.config.set(_SETTINGS)
        self._scheduler = scheduler
        # Of this machine: the workers of a scheduler may be elsewhere.
        self._scratch = "" if scheduler else str(scratch.resolve())
        self._local: distributed.LocalCluster | None = None
        self._client: distributed.Client | None = None
        self._futures = list[distributed.Future]()
        # Studies that share a scheduler share no run, whatever their variants are called.
        self._session = uuid.uuid4().hex
        place = f"the scheduler at {scheduler}" if scheduler else f"{jobs} workers on this machine"
        try:
            self.workers = _bounded(
                lambda: self._connect(jobs, scratch), f"{place}: no start", _START, interrupt
            )
        except BaseException:
            self._close()
            raise

    def _connect(self, jobs: int, scratch: Path) -> int:
        """Connects to the workers; returns their number."""
        if not self._scheduler:
            # One thread per worker: the fleet's parent-death signal fires when the thread that started it ends.
            self._local = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50,
                local_directory=str(scratch), scheduler_kwargs={"dashboard": False, "dashboard_address": ":0"},
            )  # fmt: skip
        try:
            self._client = distributed.Client(self._local or self._scheduler, timeout=30)
        except (OSError, TimeoutError) as error:
            raise ClusterError(f"no scheduler at {self._scheduler}: {error}") from None
        try:
            self._client.wait_for_workers(1, timeout=_ANSWER)
        except TimeoutError:
            raise ClusterError(
                f"the scheduler at {self._scheduler} has no workers; start one: dask worker"
            ) from None
        return len(self._client.ncores())

    def results(
        self,
        program: Sequence[str],
        scenarios: Mapping[Run, str],
        keep: Mapping[Run, str],
        poll: float,
    ) -> Iterator[tuple[Run, dict[str, Any] | str] | None]:
        """Executes all runs; yields each with its row, or an error text if it failed.

        Yields None every ``poll`` [s] while waiting.

        Raises:
            ClusterError: no worker is left.
        """
        assert self._client is not None, "connected by the constructor"
        runs: dict[str, Run] = {}
        done = queue.SimpleQueue[distributed.Future]()
        for number, (run, scenario) in enumerate(scenarios.items()):
            key = f"{run.name}-{self._session}"
            runs[key] = run
            future = self._client.submit(
                run_scenario,
                list(program),
                scenario,
                run,
                keep[run],
                self._scratch,
                key=key,
                pure=False,
                priority=-number,
                retries=0,
            )
            self._futures.append(future)
            future.add_done_callback(done.put)
        seen = time.monotonic()
        left = len(runs)
        while left:
            try:
                future = done.get(timeout=poll)
            except queue.Empty:
                seen = self._check_workers(seen)
                yield None
                continue
            left -= 1
            yield runs[future.key], _outcome(future)

    def _check_workers(self, seen: float) -> float:
        """Returns when a worker was last connected, which was at ``seen`` so far [s, monotonic].

        Raises:
            ClusterError: that was too long ago.
        """
        assert self._client is not None, "connected by the constructor"
        now = time.monotonic()
        if self._client.scheduler_info()["workers"]:
            return now
        if now - seen > _NO_WORKER:
            raise ClusterError(
                f"no worker has been connected for {_NO_WORKER:g} s; the same command continues"
            )
        return seen

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _close(self) -> None:
        """Cancels what is left and ends the local workers, in bounded time."""

        def close() -> None:
            if self._client is not None:
                if self._futures:
                    self._client.cancel(self._futures, force=True)
                self._client.close(timeout=_CLOSING)
            if self._local is not None:
                self._local.close(timeout=_CLOSING)

        closing = threading.Thread(target=close, name="close cluster", daemon=True)
        closing.start()
        closing.join(_CLOSING)


def _bounded(call: Callable[[], Value], what: str, timeout: float, interrupt: Interrupt) -> Value:
    """Returns what ``call`` returns, from a thread that it may block.

    Raises:
        ClusterError: it takes longer than ``timeout`` [s].
        Interrupted: the user has asked for the end meanwhile.
    """
    values: list[Value] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            values.append(call())
        except BaseException as error:  # noqa: BLE001 - raised again below, in the caller's thread
            errors.append(error)
        interrupt.wake()

    threading.Thread(target=work, name=what, daemon=True).start()
    deadline = time.monotonic() + timeout
    while not (values or errors):
        interrupt.wait(max(0.0, deadline - time.monotonic()))
        interrupt.check()
        if time.monotonic() >= deadline and not (values or errors):
            raise ClusterError(f"{what} within {timeout:g} s")
    if errors:
        raise errors[0]
    return values[0]


def _outcome(future: distributed.Future) -> dict[str, Any] | str:
    """Returns the row of a run that is done, or why there is none."""
    if future.cancelled():
        return "the connection to the scheduler was lost"
    try:
        error = future.exception(timeout=_ANSWER)
        return (
            future.result(timeout=_ANSWER) if error is None else f"{type(error).__name__}: {error}"
        )
    except TimeoutError:
        return f"its worker did not send the result within {_ANSWER:g} s"
