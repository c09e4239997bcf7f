"""``pioneer_bench ros2``: the door to ROS 2 beside a bridge of rclpy and rospy objects, in the same run."""

import argparse
import contextlib
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from pioneer_bench.adapters.door_site import (
    PEER,
    DoorSite,
    cpu_of,
    private_memory,
    result_of,
)
from pioneer_bench.adapters.fleet import Process
from pioneer_bench.core.door import (
    BRIDGE,
    DOOR,
    IMAGE_GOAL,
    SCAN_GOAL,
    WAYS,
    Carried,
    FleetCost,
    Received,
    Stream,
    carried_rows,
    conversion_rows,
    fleet_rows,
    fleet_streams,
    image_stream,
    latency_rows,
    pose_stream,
    scan_stream,
)
from pioneer_bench.core.row import Row, table
from pioneer_bench.nodes.stand_in import serialised_example
from pioneer_bench.report import finish
from pioneer_harness.error import HarnessError
from pioneer_ros2.message import MessageTypes

CONVERSIONS, LONG_ENOUGH = 5, 0.1
"""Repetitions, of which the least counts, and the CPU time of each [s]."""
SETTLE = 2.0
"""Time after its start, or after its readers came or went, for which a process is not yet measured [s]."""
SCAN, IMAGE = "scan of 180 beams", "image of 1.05 MB"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument("--quick", action="store_true", help="one repetition, short windows")
    parser.add_argument("--robots", type=int, default=5, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="TRIAL", help="some of the trials, by their names"
    )
    parser.add_argument(
        "--repetitions", type=int, default=3, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seconds", type=float, default=4.0, help="length of each window [s]")


def run(options: argparse.Namespace) -> int:
    """Runs all trials; returns 0 if every goal is met, 1 if one is missed, 2 if a trial failed."""
    if not PEER.exists():
        print(
            f"the bench needs a ROS 2, which PyPI has for Debian 12's Python 3.11 only: no {PEER}"
        )
        return 2
    rows: list[Row] = []
    failure = ""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pioneer-bench-")))
        # rosmaster runs in this process and prints a traceback for each node that was killed.
        log = stack.enter_context((folder / "master.log").open("w"))
        stack.enter_context(contextlib.redirect_stderr(log))
        bench = _Bench(folder, options)
        stack.callback(bench.close)
        trials: dict[str, Callable[[], list[Row]]] = {
            "conversion": bench.conversions,
            "scans": bench.scans,
            "images": bench.images,
            "fleet": bench.fleet,
            "latency": bench.latency,
        }
        if unknown := set(options.only) - set(trials):
            print(f"no trial {', '.join(sorted(unknown))}; there are {', '.join(trials)}")
            return 2
        try:
            for what, trial in trials.items():
                if not options.only or what in options.only:
                    print(f"{what} …", flush=True)
                    found = trial()
                    print(table(found), flush=True)
                    rows += found
        except (HarnessError, OSError, subprocess.SubprocessError) as error:
            failure = str(error)
    remark = (
        f"A stand-in publishes the topics of {options.robots} driving robots; the reader is a node of rclpy (Fast DDS) "
        f"that does not deserialise. {BRIDGE}: a bridge that makes an object of rospy and one of rclpy of each message."
    )
    status = finish(options, "ros2", "The door to ROS 2", rows, remark)
    if failure:
        print(f"the bench failed: {failure}")
    return 2 if failure else status


class _Bench:
    """The trials."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        self._folder = folder
        self._site = DoorSite(folder)
        self._robots: int = options.robots
        self._repetitions = 1 if options.quick else options.repetitions
        self._seconds = 2.0 if options.quick else options.seconds

    def close(self) -> None:
        """Ends everything."""
        self._site.close()

    def conversions(self) -> list[Row]:
        """Measures the conversion from bytes to bytes, without any network."""
        found = []
        for stream, what, unit, scale, goal in (
            (scan_stream(), SCAN, "CPU µs", 1e6, SCAN_GOAL),
            (image_stream(), IMAGE, "CPU ms", 1e3, IMAGE_GOAL),
        ):
            data = serialised_example(stream.source, stream.type_name)
            times = {way: [0.0] * 0 for way in WAYS}
            for _ in range(self._repetitions):
                times[DOOR].append(_least_time_of_door(stream.type_name, data))
                times[BRIDGE].append(self._least_time_of_bridge(stream.type_name, data))
            found += conversion_rows(what, unit, scale, times, goal)
        return found

    def _least_time_of_bridge(self, type_name: str, data: bytes) -> float:
        path = self._folder / "message"
        path.write_bytes(type_name.encode() + b"\n" + data)
        return self._site.bridge_conversion(path)

    def scans(self) -> list[Row]:
        """Measures the cost of carrying scans."""
        return carried_rows(SCAN, "CPU µs", 1e6, self._carried(scan_stream()))

    def images(self) -> list[Row]:
        """Measures the cost of carrying images."""
        return carried_rows(IMAGE, "CPU ms", 1e3, self._carried(image_stream()))

    def _carried(self, stream: Stream) -> dict[str, list[Carried]]:
        found: dict[str, list[Carried]] = {way: [] for way in WAYS}
        with self._site.stand_in([stream]):
            for _ in range(self._repetitions):
                for way in WAYS:
                    found[way].append(self._carried_by(way, stream))
        return found

    def _carried_by(self, way: str, stream: Stream) -> Carried:
        with (
            self._site.carrier(way, [stream]) as carrier,
            self._site.listener([stream], self._seconds) as listener,
        ):
            before, began = cpu_of(carrier), time.monotonic()
            result = result_of(listener, self._seconds)
            spent = (cpu_of(carrier) - before) / (time.monotonic() - began)
        return Carried(**result, cost=spent / stream.rate)

    def fleet(self) -> list[Row]:
        """Measures a process beside a fleet: idle, and with one reader of every topic."""
        streams = fleet_streams(self._robots)
        found: dict[str, list[FleetCost]] = {way: [] for way in WAYS}
        with self._site.stand_in(streams):
            for _ in range(self._repetitions):
                for way in WAYS:
                    found[way].append(self._fleet_cost(way, streams))
        return fleet_rows(self._robots, found)

    def _fleet_cost(self, way: str, streams: list[Stream]) -> FleetCost:
        transforms = None
        with self._site.carrier(way, streams) as carrier:
            idle = self._rate(carrier)
            with self._site.listener(streams, 0.0):
                read = self._rate(carrier)
                if way == DOOR:
                    with self._site.plain_reader(streams):
                        transforms = self._rate(carrier)
                memory = private_memory(carrier)
        return FleetCost(idle, read, transforms, memory)

    def _rate(self, process: Process) -> float:
        """Returns the CPU time of a process a second, once it has settled."""
        # Neither of these waits for a condition: the second is the measured period.
        time.sleep(SETTLE)
        before, began = cpu_of(process), time.monotonic()
        time.sleep(self._seconds)
        return (cpu_of(process) - before) / (time.monotonic() - began)

    def latency(self) -> list[Row]:
        """Measures the latency of poses, and that of ROS 1 and ROS 2 alone."""
        stream = pose_stream()
        direct, rclpy = list[Received](), list[Received]()
        found: dict[str, list[Received]] = {way: [] for way in WAYS}
        beside: dict[str, list[Received]] = {way: [] for way in WAYS}
        for _ in range(self._repetitions):
            with (
                self._site.rclpy("talk", stream.target, stream.rate),
                self._site.listener([stream], self._seconds) as listener,
            ):
                rclpy.append(Received(**result_of(listener, self._seconds)))
            with self._site.stand_in([stream]):
                with self._site.ros1_listener(stream, self._seconds) as listener:
                    direct.append(_of_ros1(listener, self._seconds))
                for way in WAYS:
                    with (
                        self._site.carrier(way, [stream]),
                        self._site.listener([stream], self._seconds + SETTLE) as listener,
                        self._site.ros1_listener(stream, self._seconds) as straight,
                    ):
                        beside[way].append(_of_ros1(straight, self._seconds))
                        found[way].append(Received(**result_of(listener, self._seconds)))
        return latency_rows(direct, rclpy, found, beside)


def _of_ros1(listener: Process, seconds: float) -> Received:
    result = result_of(listener, seconds)
    return Received(result["messages"], result["p50"], result["p99"])


def _least_time_of_door(type_name: str, data: bytes) -> float:
    """Returns the least CPU time of one of the door's conversions [s]."""
    convert = MessageTypes().converter(type_name).to_cdr
    times = []
    for _ in range(CONVERSIONS):
        began = time.process_time()
        count = 0
        while time.process_time() < began + LONG_ENOUGH:
            convert(data)
            count += 1
        times.append((time.process_time() - began) / count)
    return min(times)
