"""``pioneer_bench learning``: agent-steps a CPU-second of the learning environment, without ROS."""

import argparse
import time

import numpy as np
from numpy.typing import NDArray

from pioneer_bench.core.row import Row
from pioneer_bench.report import finish
from pioneer_gazebo.learning.environment import PioneerParallelEnv, pioneer

GOAL, GOAL_ROBOTS = 1200.0, 10
"""Goal in agent-steps a CPU-second, and the number of robots that it applies to."""
ACTION = (0.5, 0.4)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds this bench's options."""
    parser.add_argument(
        "--robots", type=int, nargs="+", metavar="N", default=[1, 4, 10], help="default: 1 4 10"
    )
    parser.add_argument("--world", default="utm_0", help="default: %(default)s")
    parser.add_argument(
        "--steps", type=int, default=200, metavar="K", help="of each run (default %(default)s)"
    )
    parser.add_argument(
        "--repeat", type=int, default=3, metavar="K", help="runs of each size (default %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Runs the bench; returns 0 if the goal is met, else 1."""
    robot, rows = pioneer(), list[Row]()
    for robots in options.robots:
        env = PioneerParallelEnv(options.world, robots, description=robot, limit=options.steps + 1)
        actions = dict.fromkeys(env.possible_agents, np.array(ACTION, np.float32))
        env.reset(seed=0)
        env.step(actions)  # the first step includes compilation
        rates = tuple(_rate(env, actions, options.steps, seed) for seed in range(options.repeat))
        env.close()
        goal = GOAL if robots == GOAL_ROBOTS else None
        rows.append(
            Row(f"{robots} robots: agent-steps a CPU-second", "1/s", rates, goal, at_least=True)
        )
    remark = f"{options.world}, {robot.lasers[0].samples} beams, steps of 0.1 s."
    return finish(options, "learning", "Learning", rows, remark)


def _rate(
    env: PioneerParallelEnv, actions: dict[str, NDArray[np.float32]], steps: int, seed: int
) -> float:
    env.reset(seed)
    began, count = time.process_time(), 0
    for _ in range(steps):
        count += len(env.agents)
        env.step(actions)
    return count / (time.process_time() - began)
