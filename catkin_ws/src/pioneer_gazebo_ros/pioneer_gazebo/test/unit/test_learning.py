"""Learning environments: PettingZoo's and Gymnasium's own checks, seeds, rewards, and the cost of a step."""

import math
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test

from pioneer_gazebo.error import ModelError
from pioneer_gazebo.learning.environment import EXTRA, PioneerEnv, PioneerParallelEnv, _free_space
from pioneer_gazebo.learning.environment import pioneer as pioneer_description
from pioneer_gazebo.world.robot import Robot

STRAIGHT: dict[str, Any] = {"starts": [(-4.5, 3.5, -math.pi / 2)], "goals": [(-4.5, 2.0)]}


@pytest.fixture(scope="module")
def pioneer() -> Robot:
    return pioneer_description()


def test_pettingzoos_own_checks_pass(pioneer: Robot) -> None:
    env = PioneerParallelEnv(robots=3, description=pioneer, limit=40)
    parallel_api_test(env, num_cycles=100)
    env.close()
    parallel_seed_test(
        lambda: PioneerParallelEnv(robots=2, description=pioneer, limit=30), num_cycles=40
    )


@pytest.mark.filterwarnings("ignore")  # gymnasium's recommendations on spaces
def test_gymnasiums_own_check_passes(pioneer: Robot) -> None:
    env = PioneerEnv(description=pioneer, limit=20)
    check_env(env, skip_render_check=True)
    env.close()


def test_a_robot_that_drives_to_its_goal_is_rewarded_for_the_way_and_terminated(
    pioneer: Robot,
) -> None:
    env = PioneerEnv(description=pioneer, **STRAIGHT)
    observation, _ = env.reset(seed=1)
    assert observation[-EXTRA] == pytest.approx(1.5)
    rewards, terminated = [], False
    while not terminated:
        observation, reward, terminated, truncated, info = env.step(
            np.array([1.0, 0.0], np.float32)
        )
        rewards.append(reward)
        assert not truncated
    assert info["state"].reached
    assert sum(rewards) == pytest.approx(10.0 + 1.5 - info["state"].distance, abs=0.01)
    env.close()


def test_a_reward_of_ones_own_counts_collisions(pioneer: Robot) -> None:
    env = PioneerEnv(description=pioneer, starts=[(-4.5, 3.5, 0.0)], goals=[(-4.5, -3.0)], limit=40,
                     reward=lambda state: -float(state.collided))  # fmt: skip
    env.reset(seed=1)
    total = sum(env.step(np.array([1.0, 0.0], np.float32))[1] for _ in range(30))
    assert total <= -1.0, "it drives against the block to its right"
    env.close()


def test_the_same_seed_gives_the_same_bits_also_in_an_environment_that_was_used(
    pioneer: Robot,
) -> None:
    def course(env: PioneerParallelEnv) -> bytes:
        seen, _ = env.reset(seed=7)
        found = [seen[agent].tobytes() for agent in env.agents]
        for _ in range(15):
            seen, *_ = env.step(dict.fromkeys(env.agents, np.array([0.8, 0.3], np.float32)))
            found += [one.tobytes() for one in seen.values()]
        return b"".join(found)

    fresh, used = (PioneerParallelEnv(robots=2, description=pioneer) for _ in range(2))
    course(used)
    assert course(fresh) == course(used)
    fresh.close()
    used.close()


def test_wheels_may_be_commanded_instead_of_the_body(pioneer: Robot) -> None:
    def pose(action: tuple[float, float], **options: bool) -> tuple[float, float, float]:
        env = PioneerEnv(description=pioneer, **STRAIGHT, **options)
        env.reset(seed=1)
        for _ in range(10):
            state = env.step(np.array(action, np.float32))[-1]["state"]
        env.close()
        return (*state.pose.position[:2], state.pose.yaw)

    assert pose((0.6, 0.6), wheels=True) == pytest.approx(pose((0.6, 0.0)), abs=1e-6)
    x, y, yaw = pose((-0.2, 0.2), wheels=True)
    assert (x, y) == pytest.approx((-4.5, 3.5), abs=0.02)
    assert yaw > -math.pi / 2 + 0.3, "the right wheel forwards turns it to the left"


def test_numbers_of_starts_and_robots_must_fit(pioneer: Robot) -> None:
    with pytest.raises(ValueError, match="starts must be 2, one a robot, not 1"):
        PioneerParallelEnv(robots=2, description=pioneer, starts=[(0.0, 0.0, 0.0)])


def test_a_second_of_processor_takes_many_steps_of_many_agents(
    pioneer: Robot, record_property
) -> None:  # type: ignore[no-untyped-def]
    """The benchmark checks the target of 1,200; this lower bound also holds on a busy machine."""
    assert len(pioneer.lasers) == 1
    assert pioneer.lasers[0].samples == 180
    env = PioneerParallelEnv("utm_0", robots=10, description=pioneer)
    env.reset(seed=1)
    actions = dict.fromkeys(env.possible_agents, np.array([0.5, 0.4], np.float32))
    began, count = time.process_time(), 0
    for _ in range(100):
        count += len(env.agents)
        env.step(actions)
    rate = count / (time.process_time() - began)
    record_property("agent_steps_per_cpu_second", rate)
    env.close()
    assert rate > 600


def rooms(folder: Path) -> Path:
    """Returns a world's file with its map beside it: two closed rooms of 5 m by 6 m, with a wall at x = 5."""
    (folder / "rooms.world").write_text("<sdf version='1.6'><world name='rooms'></world></sdf>")
    cells = np.full((60, 100), 254, np.uint8)
    cells[[0, -1], :] = 0
    cells[:, [0, 49, 50, -1]] = 0
    (folder / "rooms.pgm").write_bytes(b"P5\n100 60\n255\n" + cells.tobytes())
    (folder / "rooms.yaml").write_text(
        "image: rooms.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "rooms.world"


def test_random_goals_can_be_reached_from_given_starts_and_starts_from_given_goals(
    tmp_path: Path,
) -> None:
    free = _free_space(rooms(tmp_path))
    rng = np.random.default_rng(1)
    for _ in range(40):
        ((_, goal),) = free.places(rng, [(1.0, 3.0)], [None], 0.6)
        assert goal[0] < 5.0
        assert math.dist(goal, (1.0, 3.0)) >= 0.6
        ((start, _),) = free.places(rng, [None], [(9.0, 3.0)], 0.6)
        assert start[0] > 5.0
        assert math.dist(start, (9.0, 3.0)) >= 0.6
        ((start, goal),) = free.places(rng, [None], [None], 0.6)
        assert (start[0] < 5.0) == (goal[0] < 5.0)
    with pytest.raises(ValueError, match=r"no robot has room at \(5, 3\)"):
        free.places(rng, [(5.0, 3.0)], [None], 0.6)


def test_a_random_start_that_a_person_occupies_is_drawn_again(pioneer: Robot) -> None:
    """With these seeds the first draw of a start is inside a walking person."""
    env = PioneerParallelEnv("small_world_people", 4, description=pioneer)
    for seed in (2, 4, 22):
        first, _ = env.reset(seed)
        again, _ = env.reset(seed)
        assert all(seen[-EXTRA] >= 0.6 for seen in first.values())
        assert all(np.array_equal(first[agent], again[agent]) for agent in env.agents)
    env.close()


def test_a_given_start_inside_something_is_an_error(pioneer: Robot) -> None:
    env = PioneerParallelEnv(
        "small_world", description=pioneer, starts=[(-4.5, 3.5, 0.0)] * 2, goals=[(-4.5, 2.0)] * 2
    )
    with pytest.raises(ModelError, match="would overlap"):
        env.reset(seed=1)
    env.close()


def test_the_speed_of_a_robot_against_a_wall_is_that_of_its_body(pioneer: Robot) -> None:
    env = PioneerEnv(
        description=pioneer, starts=[(-4.5, 3.5, 0.0)], goals=[(-4.5, -3.0)], limit=200
    )
    env.reset(seed=1)
    for _ in range(60):
        observation, *_, info = env.step(np.array([1.0, 0.0], np.float32))
    assert observation[-2] == pytest.approx(0.7, abs=0.1), "its wheels spin"
    assert info["state"].speed == pytest.approx(0.0, abs=0.05)
    env.close()


def test_a_step_without_an_episode_is_a_typed_error(pioneer: Robot) -> None:
    env = PioneerParallelEnv("small_world", 1, description=pioneer, limit=1)
    nothing = {"pioneer1": np.zeros(2, np.float32)}
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(nothing)
    env.reset(seed=1)
    env.step(nothing)
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(nothing)
    env.close()


@pytest.mark.parametrize(
    "options",
    [
        {"robots": -1},
        {"robots": 0},
        {"step": 0.0},
        {"step": -0.1},
        {"step": 0.0101},
        {"limit": 0},
        {"tolerance": 0.0},
        {"fastest": math.nan},
        {"quickest": -1.0},
    ],
)
def test_numbers_out_of_range_are_refused(pioneer: Robot, options: dict[str, float]) -> None:
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} must be"):
        PioneerParallelEnv("small_world", description=pioneer, **options)  # type: ignore[arg-type]


def test_gymnasium_makes_the_environment_by_its_name(pioneer: Robot) -> None:
    env = gymnasium.make("Pioneer-v0", world="small_world", description=pioneer, limit=3)
    env.reset(seed=1)
    *_, terminated, truncated, info = [env.step(np.zeros(2, np.float32)) for _ in range(3)][-1]
    assert (terminated, truncated) == (False, True)
    assert info["is_success"] is False
    env.close()


def test_observations_have_finite_bounds_and_may_be_normalised(pioneer: Robot) -> None:
    start, goal = [(0.0, -3.0, 0.0)], [(4.0, -3.0)]
    seen = {}
    for normalised in (False, True):
        env = PioneerEnv(description=pioneer, starts=start, goals=goal, normalised=normalised)
        space = env.observation_space
        assert np.isfinite(space.low).all()
        assert np.isfinite(space.high).all()
        env.reset(seed=1)
        for _ in range(10):
            observation, *_ = env.step(np.array([1.0, 0.2], np.float32))
            assert space.contains(observation)
        seen[normalised] = observation
        env.close()
    scale = [10.0, 1.0, 1.0, 0.7, 1.5]
    assert seen[True][-EXTRA:] * scale == pytest.approx(seen[False][-EXTRA:], abs=1e-3)
    assert np.abs(seen[True]).max() <= 1.0


def test_a_robot_at_its_goal_in_the_last_step_is_terminated_and_not_truncated(
    pioneer: Robot,
) -> None:
    env = PioneerEnv(description=pioneer, **STRAIGHT)
    env.reset(seed=1)
    steps = 0
    terminated = False
    while not terminated:
        *_, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        steps += 1
    assert info["is_success"] is True
    env.close()
    env = PioneerEnv(description=pioneer, **{**STRAIGHT, "limit": steps})
    env.reset(seed=1)
    ends = [env.step(np.array([1.0, 0.0], np.float32))[2:4] for _ in range(steps)]
    assert ends[-1] == (True, False)
    env.close()


def test_an_episode_may_have_starts_and_goals_of_its_own(pioneer: Robot) -> None:
    env = PioneerEnv("small_world", description=pioneer)
    own = {"starts": [(0.0, -3.0, 0.0)], "goals": [(3.0, -3.0)]}
    observation, _ = env.reset(seed=1, options=own)
    assert observation[-EXTRA:-2] == pytest.approx([3.0, 0.0, 1.0], abs=1e-3)
    drawn, _ = env.reset(seed=1)
    assert abs(float(drawn[-EXTRA]) - 3.0) > 1e-3
    with pytest.raises(ValueError, match="goals must be 1, one a robot, not 2"):
        env.reset(options={"goals": [(3.0, -3.0), (1.0, 1.0)]})
    env.close()


@pytest.mark.parametrize(
    "action",
    [np.zeros(3, np.float32), np.zeros((2, 1), np.float32), np.float32(1.0), [math.nan, 0.0]],
)
def test_an_action_that_is_not_two_numbers_is_refused(pioneer: Robot, action: Any) -> None:
    env = PioneerEnv("small_world", description=pioneer)
    env.reset(seed=1)
    with pytest.raises(ValueError, match="the action of pioneer1 must be two numbers"):
        env.step(action)
    env.close()


def test_an_agent_without_an_action_is_named(pioneer: Robot) -> None:
    env = PioneerParallelEnv("small_world", 2, description=pioneer)
    env.reset(seed=1)
    with pytest.raises(ValueError, match="pioneer2 has no action"):
        env.step({"pioneer1": np.zeros(2, np.float32)})
    env.close()
