"""Learning environments over the simulator's core: PettingZoo's ``ParallelEnv`` and Gymnasium's ``Env``, without ROS.

    from pioneer_gazebo.learning.environment import PioneerEnv, PioneerParallelEnv

    env = PioneerParallelEnv(world="small_world", robots=4)
    observations, _ = env.reset(seed=1)

Each robot observes its laser, its goal and its own motion, and commands body or wheel velocities. Both packages are
optional.
"""

import dataclasses
import math
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pioneer_gazebo.error import DescriptionError, ModelError
from pioneer_gazebo.fleet.drawn_map import read_map
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.pose import Pose, quaternion_from_rpy
from pioneer_gazebo.world.resource import map_path, model_path, package_directory, world_path
from pioneer_gazebo.world.robot import Robot
from pioneer_gazebo.world.sdf import world_from_sdf
from pioneer_gazebo.world.urdf import robot_from_urdf
from pioneer_node.core.reach import clearance, connected

try:
    from gymnasium import Env, register, spaces
    from gymnasium.error import ResetNeeded
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError(
        f"learning needs gymnasium and pettingzoo (pip install gymnasium pettingzoo): {error}"
    ) from error

Array = NDArray[np.float32]
EXTRA = 5
"""Values after the laser ranges in an observation: goal distance, sine and cosine of its bearing, speed, turn rate.

Speed and turn rate are those of the odometry, as the wheels report them.
"""

Place = tuple[float, float]
"""x, y in the world [m]."""

FARTHEST, FASTEST, QUICKEST = 1000.0, 10.0, 50.0
"""Bounds of an observation's distance [m], speed [m/s] and turn rate [rad/s], beyond those of any robot here."""
_FAR = 10.0
"""Distance from which on a normalised observation no longer changes [m]."""

_CLEARANCE, _APART = 0.45, 1.2
_SHORTEST_STEP = 0.01
_DRAWS = 100
"""Maximum number of random starts tried for a robot."""


@dataclasses.dataclass(frozen=True)
class State:
    """A robot's state after a step, for computing rewards."""

    pose: Pose  #: in the world
    distance: float  #: to the goal [m]
    progress: float  #: decrease of ``distance`` in this step [m]
    speed: float  #: of the body, ahead [m/s]; 0 for a robot whose wheels spin against a wall
    turn: float  #: yaw rate of the body [rad/s]
    reached: bool  #: whether the robot is at its goal
    collided: bool  #: whether a collision started in this step
    nearest: float  #: smallest range of the scan [m]


Reward = Callable[[State], float]


def progress_reward(state: State) -> float:
    """Returns the default reward: the progress, plus 10 for the goal and -5 for a collision."""
    return state.progress + 10.0 * state.reached - 5.0 * state.collided


class PioneerParallelEnv(ParallelEnv[str, Array, Array]):  # type: ignore[misc]
    """Several robots in one world, each driving to its own goal.

    An observation is float32: the scan's ranges divided by the laser's maximum range (1 for no hit), then `EXTRA`
    values. An action is two values in -1 … 1: fractions of the maximum speed and turn rate, or of the maximum wheel
    speed. An agent is terminated at its goal, and truncated with all others after ``limit`` steps. Runs with the same
    seed are bit-identical. An info has ``state`` (`State`) and ``is_success``.
    """

    metadata = {"name": "pioneer_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012 - PettingZoo's form

    def __init__(
        self, world: str = "small_world", robots: int = 2, *, description: Robot | None = None,
        starts: Sequence[tuple[float, float, float]] = (), goals: Sequence[tuple[float, float]] = (),
        reward: Reward = progress_reward, step: float = 0.1, limit: int = 600, tolerance: float = 0.3,
        fastest: float = 0.7, quickest: float = 1.5, wheels: bool = False, normalised: bool = False,
    ) -> None:  # fmt: skip
        """Reads world and robot.

        Args:
            world: name of a world, or path of a ``.world`` file; without ``starts`` and ``goals`` its map is required.
            robots: number of robots.
            description: of all robots, with a drive and a laser; None for the Pioneer.
            starts: x, y [m] and heading [rad] of each robot; empty for random ones.
            goals: x, y [m] of each robot; empty for random reachable ones.
            reward: computes the reward of a robot's step.
            step: simulated time of a step [s], at least 0.01 s, a multiple of 1/600 s.
            limit: maximum number of steps of an episode.
            tolerance: distance to a goal at which it is reached [m].
            fastest: speed of the action 1 [m/s].
            quickest: turn rate of the action 1 [rad/s].
            normalised: whether all values of an observation are in -1 … 1: the distance in 10 m, speed and turn rate
                in those of the action 1, each clipped.
            wheels: whether an action is the left and right wheels' rim speeds, as fractions of ``fastest``.

        Raises:
            SimulatorError: there is no such world, or it cannot be read.
            ValueError: the numbers of robots, starts and goals differ, or a number is out of its range.
        """
        if robots < 1:
            raise ValueError(f"robots must be 1 or more, not {robots}")
        if not _SHORTEST_STEP <= step < math.inf:
            raise ValueError(f"step must be {_SHORTEST_STEP:g} s or more, not {step:g}")
        if abs(step * TICK_RATE - round(step * TICK_RATE)) > 1e-6 * TICK_RATE:
            raise ValueError(f"step must be a multiple of 1/{TICK_RATE} s, not {step:g}")
        if limit < 1:
            raise ValueError(f"limit must be 1 or more, not {limit}")
        for name, value in (("tolerance", tolerance), ("fastest", fastest), ("quickest", quickest)):
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be above 0 and finite, not {value:g}")
        self.possible_agents = [f"pioneer{number}" for number in range(1, robots + 1)]
        self._check_number("starts", starts)
        self._check_number("goals", goals)
        path = world_path(world)
        self._world, self._free = (
            world_from_sdf(path, model_path()),
            None if starts and goals else _free_space(path),
        )
        self._robot = description or pioneer()
        self._starts, self._goals_given, self._reward = starts, goals, reward
        self._ticks, self._limit, self._tolerance = round(step * TICK_RATE), limit, tolerance
        # A goal within tolerance would end the episode in its first step.
        self._nearest_goal = 2.0 * tolerance
        self._most, self._wheels = np.array([fastest, fastest if wheels else quickest]), wheels
        self.agents = list[str]()
        laser = self._robot.lasers[0]
        self._reach = laser.max_range
        self._normalised = normalised
        self._scale = np.array([_FAR, 1.0, 1.0, fastest, quickest])
        most = np.ones(EXTRA) if normalised else np.array([FARTHEST, 1.0, 1.0, FASTEST, QUICKEST])
        least = np.array([0.0, *-most[1:]])
        self._bounds = least, most
        low = np.concatenate([np.zeros(laser.samples), least])
        high = np.concatenate([np.ones(laser.samples), most])
        self._observations = spaces.Box(low.astype("f4"), high.astype("f4"))
        self._actions = {
            agent: spaces.Box(-1.0, 1.0, (2,), np.float32) for agent in self.possible_agents
        }
        self._engine: BulletEngine | None = None
        self._rng = np.random.default_rng()

    def observation_space(self, agent: str) -> spaces.Box:
        """Returns the observation space, which all robots share."""
        del agent
        return self._observations

    def action_space(self, agent: str) -> spaces.Box:
        """Returns a robot's action space."""
        return self._actions[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Starts an episode in a new world; without a seed, the random sequence continues.

        Args:
            seed: of the episode.
            options: ``starts`` and ``goals`` of this episode, as for the constructor; others have no effect.

        Raises:
            ValueError: there is not one for each robot, or a random one is needed and the map was not read.
        """
        given = options or {}
        starts = given.get("starts", self._starts)
        goals = given.get("goals", self._goals_given)
        self._check_number("starts", starts)
        self._check_number("goals", goals)
        if not (starts and goals) and self._free is None:
            raise ValueError("starts and goals must both be given: the map was not read")
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.close()
        physics = Physics()
        self._engine = BulletEngine(physics)
        self._simulation = Simulation(
            self._engine, triangles_of_mesh, physics, int(self._rng.integers(2**31))
        )
        self._simulation.load(self._world)
        self.agents = list(self.possible_agents)
        self._entities = dict[str, Entity]()
        self._goals = dict[str, tuple[float, float]]()
        places = self._places(starts, goals)
        for number, agent in enumerate(self.agents):
            self._entities[agent] = self._spawned(number, places, starts)
            self._goals[agent] = places[number][1]
        self._count, self._distances = 0, {agent: self._distance(agent) for agent in self.agents}
        return {agent: self._observation(agent) for agent in self.agents}, {
            agent: {} for agent in self.agents
        }

    def _check_number(self, name: str, given: Sequence[Any]) -> None:
        """Raises ValueError unless there is none, or one for each robot."""
        robots = len(self.possible_agents)
        if len(given) not in (0, robots):
            raise ValueError(f"{name} must be {robots}, one a robot, not {len(given)}")

    def _places(
        self,
        given_starts: Sequence[tuple[float, float, float]],
        given_goals: Sequence[tuple[float, float]],
    ) -> list[tuple[Place, Place]]:
        """Returns each robot's start and goal."""
        starts = [(float(x), float(y)) for x, y, _ in given_starts]
        goals = [(float(x), float(y)) for x, y in given_goals]
        if self._free is None or (starts and goals):
            return list(zip(starts, goals, strict=True))
        nothing = [None] * len(self.possible_agents)
        return self._free.places(self._rng, starts or nothing, goals or nothing, self._nearest_goal)

    def _spawned(
        self,
        number: int,
        places: list[tuple[Place, Place]],
        starts: Sequence[tuple[float, float, float]],
    ) -> Entity:
        """Spawns a robot at its start; a random start that somebody occupies is drawn again, also in ``places``.

        Raises:
            ModelError: there is something at the given start, or at each one drawn.
        """
        agent = self.possible_agents[number]
        turned = float(self._rng.uniform(-math.pi, math.pi))
        yaw = float(starts[number][2]) if starts else turned
        rotation = quaternion_from_rpy(0.0, 0.0, yaw)
        for _ in range(_DRAWS):
            (x, y), _ = places[number]
            try:
                return self._simulation.add_robot(
                    agent, agent, self._robot, Pose((x, y, 0.0), rotation)
                )
            except ModelError:
                if starts:
                    raise
                # The map does not show what moves, such as people.
                places[number] = self._drawn_again(number, places)
        raise ModelError(f"{agent}: something was in the way at {_DRAWS} random starts")

    def _drawn_again(self, number: int, places: list[tuple[Place, Place]]) -> tuple[Place, Place]:
        """Returns a robot's goal with another random start."""
        assert self._free is not None, "without a map, all starts are given"
        starts: list[Place | None] = [start for start, _ in places]
        starts[number] = None
        goals = [goal for _, goal in places]
        return self._free.places(self._rng, starts, goals, self._nearest_goal)[number]

    def step(
        self, actions: dict[str, Array]
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Advances all robots; returns observations, rewards, terminations, truncations and infos (``state``).

        Raises:
            ResetNeeded: no episode runs.
            ValueError: an agent has no action, or one that is not two numbers.
        """
        if not self.agents:
            raise ResetNeeded("no episode runs: call reset first")
        commands = {agent: self._command(agent, actions) for agent in self.agents}
        for agent, (speed, turn) in commands.items():
            drive = self._entities[agent].drives[0]
            if self._wheels:
                speed, turn = (
                    (speed + turn) / 2.0,
                    (turn - speed) / drive.drive.config.wheelSeparation,
                )
            drive.command(self._simulation.moment, speed, turn)
        self._simulation.advance(self._simulation.tick + self._ticks)
        self._count += 1
        touched = {entity.name for entity in self._simulation.collided()}
        observations = {agent: self._observation(agent) for agent in self.agents}
        states = {
            agent: self._state(agent, observations[agent], agent in touched)
            for agent in self.agents
        }
        ended = {agent: state.reached for agent, state in states.items()}
        late = {agent: self._count >= self._limit and not ended[agent] for agent in self.agents}
        rewards = {agent: float(self._reward(state)) for agent, state in states.items()}
        infos: dict[str, dict[str, Any]] = {
            agent: {"state": state, "is_success": state.reached} for agent, state in states.items()
        }
        for agent in [agent for agent in self.agents if ended[agent]]:
            self._entities[agent].drives[0].command(self._simulation.moment, 0.0, 0.0)
        self.agents = [agent for agent in self.agents if not (ended[agent] or late[agent])]
        return observations, rewards, ended, late, infos

    def _command(self, agent: str, actions: dict[str, Array]) -> tuple[float, float]:
        """Returns the speeds that an agent's action commands.

        Raises:
            ValueError: there is none, or it is not two numbers.
        """
        if agent not in actions:
            raise ValueError(f"{agent} has no action")
        action = np.asarray(actions[agent], dtype=np.float64)
        if action.shape != (2,) or not np.isfinite(action).all():
            raise ValueError(f"the action of {agent} must be two numbers, not {actions[agent]!r}")
        first, second = np.clip(action, -1.0, 1.0) * self._most
        return float(first), float(second)

    def close(self) -> None:
        """Frees the physics engine."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None

    def _distance(self, agent: str) -> float:
        x, y, _ = self._simulation.pose(self._entities[agent]).position
        return math.dist((x, y), self._goals[agent])

    def _observation(self, agent: str) -> Array:
        entity, goal = self._entities[agent], self._goals[agent]
        pose = self._simulation.pose(entity)
        x, y, _ = pose.position
        bearing = math.atan2(goal[1] - y, goal[0] - x) - pose.yaw
        motion = entity.drives[0].drive.odometry
        ranges = np.clip(self._simulation.ranges(entity, entity.lasers[0]) / self._reach, 0.0, 1.0)
        extra = np.array(
            [
                math.dist((x, y), goal),
                math.sin(bearing),
                math.cos(bearing),
                motion.speed,
                motion.turn,
            ]
        )
        if self._normalised:
            extra /= self._scale
        return np.concatenate([ranges, np.clip(extra, *self._bounds)], dtype=np.float32)

    def _state(self, agent: str, observation: Array, collided: bool) -> State:
        distance = self._distance(agent)
        progress, self._distances[agent] = self._distances[agent] - distance, distance
        entity = self._entities[agent]
        pose = self._simulation.pose(entity)
        velocity = self._simulation.velocity(entity).seen_from(pose.rotation)
        return State(
            pose=pose,
            distance=distance,
            progress=progress,
            speed=velocity.linear[0],
            turn=velocity.angular[2],
            reached=distance <= self._tolerance,
            collided=collided,
            nearest=float(observation[:-EXTRA].min()) * self._reach,
        )


class PioneerEnv(Env[Array, Array]):  # type: ignore[misc]
    """A single robot as a Gymnasium environment; arguments as for `PioneerParallelEnv`, without ``robots``."""

    def __init__(self, world: str = "small_world", **options: Any) -> None:
        self._env = PioneerParallelEnv(world, 1, **options)
        (self._agent,) = self._env.possible_agents
        self.observation_space = self._env.observation_space(self._agent)
        self.action_space = self._env.action_space(self._agent)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode."""
        super().reset(seed=seed)
        observations, infos = self._env.reset(seed, options)
        return observations[self._agent], infos[self._agent]

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advances the robot by one step."""
        seen, rewards, ended, late, infos = self._env.step({self._agent: action})
        return (
            seen[self._agent],
            rewards[self._agent],
            ended[self._agent],
            late[self._agent],
            infos[self._agent],
        )

    def close(self) -> None:
        """Frees the physics engine."""
        self._env.close()


register(id="Pioneer-v0", entry_point=PioneerEnv)


def pioneer() -> Robot:
    """Returns the Pioneer of pioneer_description, expanded with the workspace's xacro.

    Raises:
        DescriptionError: the package is not found in this environment.
    """
    folder = package_directory("pioneer_description")
    if folder is None:
        raise DescriptionError("package pioneer_description, which has the robot, is not found")
    command = ["xacro", str(folder / "urdf" / "pioneer3dx.xacro")]
    return robot_from_urdf(
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
    )


class _FreeSpace:
    """The positions that robots can occupy, as cells of a map."""

    def __init__(self, xy: NDArray[np.float64], part: NDArray[np.int32]) -> None:
        self._xy, self._part = xy, part

    def places(
        self,
        rng: np.random.Generator,
        starts: Sequence[Place | None],
        goals: Sequence[Place | None],
        apart: float,
    ) -> list[tuple[Place, Place]]:
        """Returns a start and a goal for each robot: those given, else random ones that reach each other.

        Args:
            rng: random generator.
            starts: each robot's start; None for a random one.
            goals: each robot's goal; None for a random one.
            apart: smallest distance from a robot's start to its goal [m], if one of them is random.

        Raises:
            ValueError: a given place has no room, or there is none for so many robots.
        """
        taken_starts: list[Place] = [start for start in starts if start is not None]
        taken_goals: list[Place] = [goal for goal in goals if goal is not None]
        pairs: list[tuple[Place, Place]] = []
        for start, goal in zip(starts, goals, strict=True):
            if start is None:
                start = self._drawn(rng, taken_starts, goal, apart)
                taken_starts.append(start)
            if goal is None:
                goal = self._drawn(rng, taken_goals, start, apart)
                taken_goals.append(goal)
            pairs.append((start, goal))
        return pairs

    def _drawn(
        self, rng: np.random.Generator, taken: Sequence[Place], other: Place | None, apart: float
    ) -> Place:
        """Returns a random place away from those taken; from ``other``, it can be reached and is not too near."""
        allowed = np.ones(len(self._xy), bool)
        for place in taken:
            allowed &= self._distances(place) >= _APART
        if other is not None:
            allowed &= (self._part == self._part_at(other)) & (self._distances(other) >= apart)
        cells = np.flatnonzero(allowed)
        if not len(cells):
            raise ValueError("the world has no room for so many robots")
        x, y = self._xy[rng.choice(cells)]
        return float(x), float(y)

    def _distances(self, place: Place) -> NDArray[np.float64]:
        distances: NDArray[np.float64] = np.hypot(*(self._xy - place).T)
        return distances

    def _part_at(self, place: Place) -> int:
        """Returns the part of the free cell nearest to a place."""
        distances = self._distances(place)
        nearest = int(distances.argmin())
        if distances[nearest] > _CLEARANCE:
            raise ValueError(f"no robot has room at ({place[0]:g}, {place[1]:g})")
        return int(self._part[nearest])


def _free_space(world: Path) -> _FreeSpace:
    """Returns where robots can stand in a world, from its map; connected cells share a part number."""
    drawn = read_map(map_path(world))
    if drawn is None:
        raise DescriptionError(f"{map_path(world)} is no map as world_to_map draws it")
    pixels = np.frombuffer(drawn.pixels, np.uint8, drawn.rows * drawn.cols).reshape(
        drawn.rows, drawn.cols
    )[::-1]
    # The world does not end in free space.
    taken = np.pad(pixels < drawn.free, 1, constant_values=True)
    clear = clearance(taken, drawn.resolution)[1:-1, 1:-1] >= _CLEARANCE
    parts = connected(clear)
    rows, cols = np.nonzero(clear)
    xy = np.column_stack(
        [drawn.x + (cols + 0.5) * drawn.resolution, drawn.y + (rows + 0.5) * drawn.resolution]
    )
    return _FreeSpace(xy, parts[rows, cols])
