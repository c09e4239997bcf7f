"""Trains the weights of `heading_policy` by the cross-entropy method.

``python3 -m pioneer_gazebo.learning.training`` writes ``learned_driver.json`` (weights, learning curve) and
``learned_driver.png`` into the current directory.
"""
# ruff: noqa: T201 - a command prints to standard output

import json
import math
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.learning.environment import EXTRA, PioneerParallelEnv, pioneer
from pioneer_gazebo.learning.heading_policy import START, act

ROBOTS, LIMIT, POPULATION, BEST, GENERATIONS = 6, 200, 10, 3, 6
TRAINED, TESTED = (1, 2), range(1000, 1010)
"""Seeds of the training and test episodes."""
STEP_COST = 0.02
_SPREAD, _LEAST_SPREAD = 0.8, 0.1


def drive(
    env: PioneerParallelEnv, reach: float, weights: NDArray[np.float64], seeds: Iterable[int]
) -> NDArray[np.float64]:
    """Returns the mean return, share of goals reached and steps over all robots; each step costs `STEP_COST`."""
    return np.mean([_episode(env, reach, weights, seed) for seed in seeds], axis=0)


def _episode(
    env: PioneerParallelEnv, reach: float, weights: NDArray[np.float64], seed: int
) -> tuple[float, float, float]:
    observations, _ = env.reset(seed)
    count, reward, reached, steps = len(env.agents), 0.0, 0, 0
    while env.agents:
        steps += len(env.agents)
        actions = {agent: _action(weights, observations[agent], reach) for agent in env.agents}
        observations, rewards, ended, _, _ = env.step(actions)
        reward, reached = reward + sum(rewards.values()), reached + sum(ended.values())
    return (reward - STEP_COST * steps) / count, reached / count, steps / count


def _action(
    weights: NDArray[np.float64], seen: NDArray[np.float32], reach: float
) -> NDArray[np.float32]:
    distance, sine, cosine = map(float, seen[-EXTRA : 3 - EXTRA])
    return np.array(
        act(weights, seen[:-EXTRA].astype(float) * reach, distance, math.atan2(sine, cosine)),
        np.float32,
    )


def main() -> None:
    """Trains, and compares the weights before and after training on unseen worlds."""
    robot, rng, curve = pioneer(), np.random.default_rng(1), list[dict[str, Any]]()
    env, reach = (
        PioneerParallelEnv("small_world", ROBOTS, description=robot, limit=LIMIT),
        robot.lasers[0].max_range,
    )
    mean, spread = np.log(START), np.full(len(START), _SPREAD)
    chosen, highest = np.array(START), -math.inf
    for generation in range(GENERATIONS):
        tried = mean + spread * rng.normal(size=(POPULATION, len(mean)))
        results = np.array([drive(env, reach, np.exp(weights), TRAINED) for weights in tried])
        order = np.argsort(-results[:, 0])
        best = tried[order[:BEST]]
        if results[order[0], 0] > highest:
            chosen, highest = np.exp(best[0]), results[order[0], 0]
        mean, spread = best.mean(axis=0), best.std(axis=0) + _LEAST_SPREAD
        curve.append(
            {
                "cpu_seconds": round(time.process_time(), 1),
                "returns": results[:, 0].round(2).tolist(),
            }
        )
        print(
            f"generation {generation}: mean return {results[:, 0].mean():.2f}, reached {results[:, 1].mean():.0%}",
            flush=True,
        )
    tests = {"before": np.array(START), "after": chosen.round(3)}
    found = {
        name: dict(
            zip(
                ("return", "reached", "steps"),
                drive(env, reach, one, TESTED).round(3).tolist(),
                strict=True,
            )
        )
        for name, one in tests.items()
    }
    content = {"weights": tests["after"].tolist(), "curve": curve, "test": found}
    Path("learned_driver.json").write_text(json.dumps(content, indent=1) + "\n")
    print(found)
    _draw(curve)


def _draw(curve: list[dict[str, Any]]) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 3.6), layout="constrained")
    seconds = [one["cpu_seconds"] for one in curve]
    for one in curve:
        axes.plot([one["cpu_seconds"]] * POPULATION, one["returns"], ".", color="0.6")
    axes.plot(
        seconds, [np.mean(one["returns"]) for one in curve], "o-", label="mean of a generation"
    )
    axes.plot(seconds, [max(one["returns"]) for one in curve], "-", label="best")
    axes.set(xlabel="CPU time [s]", ylabel="return of a robot", title="Learned driver, small_world")
    axes.legend()
    figure.savefig("learned_driver.png", dpi=100)


if __name__ == "__main__":
    main()
