"""``pioneer_bench nav``: success, safety and cost of one robot driving tours of waypoints."""

import argparse
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

from pioneer_bench.core.tour import CONDITIONS, PEER_SECONDS, Tour, tour_rows
from pioneer_bench.hard import hard_rows
from pioneer_bench.nav_kernel import kernel_rows
from pioneer_bench.report import finish, measured

EXPLANATION = (
    "A sample is a tour of one robot, and for kernels a way or a call. C++: Noetic's stack, another day; its tours in "
    f"Stage and another maze: twelve waypoints of 160 m in {PEER_SECONDS:.0f} s."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument(
        "--condition", nargs="+", choices=CONDITIONS, default=list(CONDITIONS), help="default: all"
    )
    parser.add_argument(
        "--seeds", type=int, nargs="+", metavar="S", default=[1, 2, 3, 4, 5], help="default: 1 to 5"
    )
    parser.add_argument(
        "--waypoints", type=int, default=12, metavar="K", help="of a tour (default %(default)s)"
    )
    parser.add_argument("--world", default="closed_maze", help="default: %(default)s")
    parser.add_argument(
        "--real-time-factor", type=float, default=3.0, help="0: as fast as possible"
    )
    parser.add_argument(
        "--parallel", type=int, default=1, metavar="N", help="tours at a time (default %(default)s)"
    )
    parser.add_argument(
        "--kernels",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="measure plans and cycles without ROS, too",
    )
    parser.add_argument(
        "--hard", action="store_true", help="drive hard courses without ROS instead of tours"
    )


def run(options: argparse.Namespace) -> int:
    """Drives all tours; returns 0 if every goal is met, 1 if one is missed, 2 if a tour could not be driven."""
    remark = f"Real-time factor {options.real_time_factor:g}, {options.parallel} at a time. {EXPLANATION}"
    if options.hard:
        return finish(
            options,
            "navigation",
            "Navigation",
            hard_rows(max(options.seeds), options.parallel),
            remark,
        )
    asked = [(condition, seed) for condition in options.condition for seed in options.seeds]
    with ThreadPoolExecutor(options.parallel) as pool:
        tours = list(pool.map(lambda one: _tour(one[0], one[1], options), asked))
    driven = [tour for tour in tours if tour is not None]
    rows = []
    for name in options.condition:
        own = [tour for tour in driven if tour.condition == name]
        rows += tour_rows(CONDITIONS[name], own) if own else []
    if options.kernels:
        print("kernels …", flush=True)
        rows += kernel_rows()
    status = finish(
        options, "navigation", "Navigation", rows, remark, tours=[asdict(tour) for tour in driven]
    )
    return status if len(driven) == len(tours) else 2


def _tour(condition: str, seed: int, options: argparse.Namespace) -> Tour | None:
    """Returns the results of one tour; prints a line and returns None if it could not be driven."""
    label = f"{CONDITIONS[condition].title}, seed {seed}"
    asked = {name: getattr(options, name) for name in ("waypoints", "world", "real_time_factor")}
    config = {"condition": condition, "seed": seed, **asked}
    values = measured("tour", config, lambda line: print(f"{label}: {line}", flush=True))
    tour = Tour(**values) if values else None
    print(f"{label}: {tour.summary() if tour else 'failed'}", flush=True)
    return tour
